# `softhand trackers` with trackers as processes.
softhand_test(trackers_command ${CMAKE_CURRENT_LIST_DIR}/trackers_command_test.cpp LINK softhand_bus softhand_runtime
  softhand_device)
target_compile_definitions(test_trackers_command PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
add_dependencies(test_trackers_command softhand softhand-tracker-replay)
