# softhand-tactile-weart as a process: messages of a simulated middleware in, hands out, contacts in, effects out.
softhand_test(weart_process ${CMAKE_CURRENT_LIST_DIR}/weart_process_test.cpp LINK softhand_bus softhand_runtime
  softhand_device)
target_compile_definitions(test_weart_process PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
add_dependencies(test_weart_process softhand-tactile-weart simulate-tactile-weart)
