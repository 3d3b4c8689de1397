# The scripts in deploy/ work the same from any folder.
add_test(NAME deploy_folder COMMAND bash ${PROJECT_SOURCE_DIR}/tests/support/check_deploy_folder.sh
  ${PROJECT_SOURCE_DIR})
