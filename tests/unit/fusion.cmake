softhand_test(fusion ${CMAKE_CURRENT_LIST_DIR}/fusion_test.cpp LINK softhand_tracker_fusion softhand_tracker_replay)
