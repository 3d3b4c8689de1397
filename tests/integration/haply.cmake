# softhand-haptic-haply as a process: reports of a simulated service in, hands out, wrenches in, forces out.
if(TARGET softhand-haptic-haply)
  softhand_test(haply_process LIVE ${CMAKE_CURRENT_LIST_DIR}/haply_process_test.cpp
    ${CMAKE_CURRENT_LIST_DIR}/haply_driver_test.cpp LINK softhand_bus softhand_runtime softhand_device softhand_model
    softhand_haptic_haply softhand_websocket_client softhand_simulated_service)
  target_compile_definitions(test_haply_process PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
  add_dependencies(test_haply_process softhand-haptic-haply simulate-haptic-haply)
endif()
