softhand_test(openxr ${CMAKE_CURRENT_LIST_DIR}/openxr_test.cpp LINK softhand_tracker_openxr)
