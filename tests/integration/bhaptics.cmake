# softhand-tactile-bhaptics as a process: contacts in, frames out to a simulated Player.
if(TARGET softhand-tactile-bhaptics)
  softhand_test(bhaptics_process LIVE ${CMAKE_CURRENT_LIST_DIR}/bhaptics_process_test.cpp LINK softhand_bus
    softhand_runtime softhand_device softhand_simulated_service)
  target_compile_definitions(test_bhaptics_process PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
  add_dependencies(test_bhaptics_process softhand-tactile-bhaptics simulate-tactile-bhaptics)
endif()
