softhand_test(runtime_config ${CMAKE_CURRENT_LIST_DIR}/runtime_config_test.cpp LINK softhand_runtime)
softhand_test(runtime_process ${CMAKE_CURRENT_LIST_DIR}/runtime_process_test.cpp LINK softhand_runtime)
softhand_test(runtime_record ${CMAKE_CURRENT_LIST_DIR}/runtime_record_test.cpp LINK softhand_runtime)
softhand_test(runtime_loop ${CMAKE_CURRENT_LIST_DIR}/runtime_loop_test.cpp LINK softhand_runtime)
