# softhand-tracker-vrpn as a process: its simulator's bytes in, DDS out.
softhand_test(vrpn_process ${CMAKE_CURRENT_LIST_DIR}/vrpn_process_test.cpp LINK softhand_bus softhand_runtime
  softhand_tracker_vrpn)
target_compile_definitions(test_vrpn_process PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
add_dependencies(test_vrpn_process softhand-tracker-vrpn simulate-tracker-vrpn)
