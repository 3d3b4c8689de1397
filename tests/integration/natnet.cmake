# softhand-tracker-natnet as a process: its simulator's bytes in, DDS out.
softhand_test(natnet_process ${CMAKE_CURRENT_LIST_DIR}/natnet_process_test.cpp LINK softhand_bus softhand_runtime
  softhand_tracker_natnet)
target_compile_definitions(test_natnet_process PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
add_dependencies(test_natnet_process softhand-tracker-natnet simulate-tracker-natnet)
