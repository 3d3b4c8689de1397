# softhand-tracker-osc as a process: its simulator's bytes in, DDS out.
softhand_test(osc_process ${CMAKE_CURRENT_LIST_DIR}/osc_process_test.cpp LINK softhand_bus softhand_runtime
  softhand_tracker_osc)
target_compile_definitions(test_osc_process PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
add_dependencies(test_osc_process softhand-tracker-osc simulate-tracker-osc)
