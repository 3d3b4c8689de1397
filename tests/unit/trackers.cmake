softhand_test(trackers ${CMAKE_CURRENT_LIST_DIR}/generator_test.cpp ${CMAKE_CURRENT_LIST_DIR}/posture_solver_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/recording_test.cpp ${CMAKE_CURRENT_LIST_DIR}/replay_tracker_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/shipped_grip_test.cpp ${CMAKE_CURRENT_LIST_DIR}/natnet_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/osc_test.cpp ${CMAKE_CURRENT_LIST_DIR}/streamer_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/vrpn_test.cpp ${CMAKE_CURRENT_LIST_DIR}/leap_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/openxr_test.cpp ${CMAKE_CURRENT_LIST_DIR}/fusion_test.cpp LINK softhand_tracker_fusion
  softhand_tracker_natnet softhand_tracker_osc softhand_tracker_streamer softhand_tracker_vrpn softhand_tracker_leap
  softhand_tracker_openxr softhand_tracker_replay)
