softhand_test(hand_simulation ${CMAKE_CURRENT_LIST_DIR}/hand_simulation_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/idle_hand_test.cpp ${CMAKE_CURRENT_LIST_DIR}/untangling_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/two_hands_test.cpp ${CMAKE_CURRENT_LIST_DIR}/soft_object_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/grid_contact_test.cpp ${CMAKE_CURRENT_LIST_DIR}/skin_simulation_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/skin_traction_test.cpp ${CMAKE_CURRENT_LIST_DIR}/step_guess_test.cpp
  LINK softhand_scene softhand_tracker_replay)
softhand_test(hand_loop ${CMAKE_CURRENT_LIST_DIR}/hand_loop_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/hand_loop_objects_test.cpp ${CMAKE_CURRENT_LIST_DIR}/hand_joint_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/soft_mirror_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/hand_size_test.cpp ${CMAKE_CURRENT_LIST_DIR}/object_scene_test.cpp LINK
  softhand_scene_file softhand_hand softhand_world)
