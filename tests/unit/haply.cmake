softhand_test(haply ${CMAKE_CURRENT_LIST_DIR}/haply_test.cpp LINK softhand_haptic_haply)
