softhand_test(runtime LIVE ${CMAKE_CURRENT_LIST_DIR}/age_test.cpp ${CMAKE_CURRENT_LIST_DIR}/runtime_config_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/runtime_process_test.cpp ${CMAKE_CURRENT_LIST_DIR}/runtime_record_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/runtime_loop_test.cpp ${CMAKE_CURRENT_LIST_DIR}/runtime_clock_offset_test.cpp LINK
  softhand_runtime)
