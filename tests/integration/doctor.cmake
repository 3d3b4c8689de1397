# `softhand doctor` with simulators of devices, and without.
softhand_test(doctor LIVE ${CMAKE_CURRENT_LIST_DIR}/doctor_test.cpp LINK softhand_bus softhand_runtime softhand_device)
target_compile_definitions(test_doctor PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin"
  DHD_STAND_IN="$<TARGET_FILE:dhd_stand_in>" HD_STAND_IN="$<TARGET_FILE:openhaptics_stand_in>")
add_dependencies(test_doctor softhand simulate-tracker-natnet simulate-tracker-vrpn simulate-tactile-weart dhd_stand_in
  openhaptics_stand_in)
if(TARGET softhand_simulated_service)
  target_compile_definitions(test_doctor PRIVATE SOFTHAND_SOCKET_TRACKERS)
  target_link_libraries(test_doctor PRIVATE softhand_simulated_service)
endif()
