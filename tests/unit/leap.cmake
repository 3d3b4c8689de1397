softhand_test(leap ${CMAKE_CURRENT_LIST_DIR}/leap_test.cpp LINK softhand_tracker_leap)
