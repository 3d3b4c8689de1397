softhand_test(trackers ${CMAKE_CURRENT_LIST_DIR}/generator_test.cpp ${CMAKE_CURRENT_LIST_DIR}/posture_solver_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/recording_test.cpp ${CMAKE_CURRENT_LIST_DIR}/replay_tracker_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/shipped_grip_test.cpp LINK softhand_tracker_replay)
