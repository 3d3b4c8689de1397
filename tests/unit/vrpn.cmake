softhand_test(vrpn ${CMAKE_CURRENT_LIST_DIR}/vrpn_test.cpp LINK softhand_tracker_vrpn)
