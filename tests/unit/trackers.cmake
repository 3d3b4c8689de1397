softhand_test(trackers ${CMAKE_CURRENT_LIST_DIR}/trackers_test.cpp LINK softhand_tracker_replay)
