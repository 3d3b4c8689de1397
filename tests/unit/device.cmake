softhand_test(device ${CMAKE_CURRENT_LIST_DIR}/device_test.cpp LINK softhand_haptic_log softhand_tactile_log)
