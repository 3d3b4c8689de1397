softhand_test(natnet ${CMAKE_CURRENT_LIST_DIR}/natnet_test.cpp LINK softhand_tracker_natnet softhand_tracker_replay)
