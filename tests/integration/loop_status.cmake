# The generator of struct LoopStatus refuses what it cannot write.
add_test(NAME loop_status COMMAND ${CMAKE_COMMAND} -DSOURCE=${PROJECT_SOURCE_DIR}
         -DBINARY=${PROJECT_BINARY_DIR}/loop_status -P ${PROJECT_SOURCE_DIR}/tests/support/check_loop_status.cmake)
