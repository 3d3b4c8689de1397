# softhand-tracker-streamer as a process: its simulator's bytes in, DDS out.
softhand_test(streamer_process ${CMAKE_CURRENT_LIST_DIR}/streamer_process_test.cpp LINK softhand_bus softhand_runtime
  softhand_device)
target_compile_definitions(test_streamer_process PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
add_dependencies(test_streamer_process softhand-tracker-streamer simulate-tracker-streamer)
