# Grounded devices with a vendor's library, as processes with stand-in libraries: cursors in, hands out, wrenches in,
# forces out.
softhand_test(grounded_libraries LIVE ${CMAKE_CURRENT_LIST_DIR}/grounded_libraries_test.cpp LINK softhand_bus
  softhand_runtime softhand_device)
target_compile_definitions(test_grounded_libraries PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin"
  DHD_STAND_IN="$<TARGET_FILE:dhd_stand_in>" HD_STAND_IN="$<TARGET_FILE:openhaptics_stand_in>")
add_dependencies(test_grounded_libraries softhand-haptic-dhd dhd_stand_in softhand-haptic-openhaptics
  openhaptics_stand_in)
