# `softhand doctor` with simulators of devices, and without.
softhand_test(doctor ${CMAKE_CURRENT_LIST_DIR}/doctor_test.cpp LINK softhand_bus softhand_runtime softhand_device)
target_compile_definitions(test_doctor PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
add_dependencies(test_doctor softhand simulate-tracker-natnet simulate-tracker-vrpn)
