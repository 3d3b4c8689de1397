# A feature that is switched off is neither searched for, nor compiled, nor linked. Each option is off alone in one
# build, and all options are off in another. These builds are configured, and built with the objects of this build.
add_test(NAME build_options COMMAND ${CMAKE_COMMAND} -DSOURCE=${PROJECT_SOURCE_DIR} -DFULL=${PROJECT_BINARY_DIR}
         -DUNITY=${SOFTHAND_UNITY} -DBINARY=${PROJECT_BINARY_DIR}/build_options
         -P ${PROJECT_SOURCE_DIR}/tests/support/check_build_options.cmake)
set_tests_properties(build_options PROPERTIES TIMEOUT 600)
