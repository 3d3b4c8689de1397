# What a build does not want is neither looked for nor compiled nor linked: each option off by itself, and all of them off, configured, and built with this build's objects.
add_test(NAME build_options COMMAND ${CMAKE_COMMAND} -DSOURCE=${PROJECT_SOURCE_DIR} -DFULL=${PROJECT_BINARY_DIR} -DBINARY=${PROJECT_BINARY_DIR}/build_options
         -P ${PROJECT_SOURCE_DIR}/tests/support/check_build_options.cmake)
set_tests_properties(build_options PROPERTIES TIMEOUT 300)
