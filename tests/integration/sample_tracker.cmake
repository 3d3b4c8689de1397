# The sample driver of docs/add-a-tracker.md as a process, and its simulator.
softhand_test(sample_tracker ${CMAKE_CURRENT_LIST_DIR}/sample_tracker_test.cpp LINK softhand_bus softhand_runtime
  softhand_device)
target_compile_definitions(test_sample_tracker PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
add_dependencies(test_sample_tracker softhand-tracker-sample simulate-tracker-sample)
