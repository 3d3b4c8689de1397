# The scripts in deploy/ work the same from any folder.
add_test(NAME deploy_folder COMMAND bash ${PROJECT_SOURCE_DIR}/tests/support/check_deploy_folder.sh
  ${PROJECT_SOURCE_DIR})
add_test(NAME deploy_security COMMAND bash ${PROJECT_SOURCE_DIR}/tests/support/check_deploy_security.sh
  ${PROJECT_SOURCE_DIR})
# What deploy/build installs and builds, and what it prints, with fake commands instead of apt and CMake.
add_test(NAME deploy_build COMMAND bash ${PROJECT_SOURCE_DIR}/tests/support/check_deploy_build.sh ${PROJECT_SOURCE_DIR})
