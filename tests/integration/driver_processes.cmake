# Each driver as a process, with a simulator that speaks the protocol of the device.
softhand_test(driver_processes LIVE ${CMAKE_CURRENT_LIST_DIR}/natnet_process_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/osc_process_test.cpp ${CMAKE_CURRENT_LIST_DIR}/vrpn_process_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/streamer_process_test.cpp ${CMAKE_CURRENT_LIST_DIR}/weart_process_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/opengloves_process_test.cpp ${CMAKE_CURRENT_LIST_DIR}/fusion_process_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/sample_glove_test.cpp ${CMAKE_CURRENT_LIST_DIR}/sample_pad_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/sample_tracker_test.cpp ${CMAKE_CURRENT_LIST_DIR}/trackers_command_test.cpp LINK
  softhand_bus softhand_runtime softhand_device softhand_tracker_natnet softhand_tracker_vrpn softhand_tracker_osc
  softhand_tracker_replay)
target_compile_definitions(test_driver_processes PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
add_dependencies(test_driver_processes softhand softhand-tracker-replay softhand-tracker-fusion
  softhand-tracker-natnet simulate-tracker-natnet softhand-tracker-osc simulate-tracker-osc softhand-tracker-vrpn
  simulate-tracker-vrpn softhand-tracker-streamer simulate-tracker-streamer softhand-tracker-sample
  simulate-tracker-sample softhand-haptic-sample softhand-haptic-opengloves simulate-haptic-opengloves
  softhand-tactile-sample simulate-tactile-sample softhand-tactile-weart simulate-tactile-weart)
