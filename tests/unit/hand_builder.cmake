find_package(nlohmann_json 3.11 REQUIRED)
if(TARGET softhand_hand_builder)
  softhand_test(hand_builder ${CMAKE_CURRENT_LIST_DIR}/hand_builder_test.cpp LINK softhand_hand_builder softhand_model
    softhand_tracker_replay)
  softhand_test(rigged_hand ${CMAKE_CURRENT_LIST_DIR}/rigged_hand_test.cpp
                LINK softhand_hand_builder softhand_model softhand_tracker_replay nlohmann_json::nlohmann_json)
endif()
