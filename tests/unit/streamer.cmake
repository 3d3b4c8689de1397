softhand_test(streamer ${CMAKE_CURRENT_LIST_DIR}/streamer_test.cpp LINK softhand_tracker_streamer
  softhand_tracker_replay)
