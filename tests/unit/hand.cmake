softhand_test(hand_simulation ${CMAKE_CURRENT_LIST_DIR}/hand_simulation_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/idle_hand_test.cpp ${CMAKE_CURRENT_LIST_DIR}/untangling_test.cpp LINK softhand_scene)
softhand_test(hand_loop ${CMAKE_CURRENT_LIST_DIR}/hand_loop_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/hand_loop_objects_test.cpp LINK softhand_hand)
softhand_test(hand_joint ${CMAKE_CURRENT_LIST_DIR}/hand_joint_test.cpp LINK softhand_hand)
softhand_test(hand_size ${CMAKE_CURRENT_LIST_DIR}/hand_size_test.cpp LINK softhand_hand softhand_scene_file)
softhand_test(skin_simulation ${CMAKE_CURRENT_LIST_DIR}/skin_simulation_test.cpp
  LINK softhand_scene softhand_tracker_replay)
softhand_test(two_hands_in_one ${CMAKE_CURRENT_LIST_DIR}/two_hands_test.cpp LINK softhand_scene)
softhand_test(soft_object ${CMAKE_CURRENT_LIST_DIR}/soft_object_test.cpp LINK softhand_scene)
softhand_test(skin_traction ${CMAKE_CURRENT_LIST_DIR}/skin_traction_test.cpp
  LINK softhand_scene softhand_tracker_replay)
