softhand_test(tracking ${CMAKE_CURRENT_LIST_DIR}/tracking_test.cpp LINK softhand_tracking)
