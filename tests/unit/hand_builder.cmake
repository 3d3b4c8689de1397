if(TARGET softhand_hand_builder)
  softhand_test(hand_builder ${CMAKE_CURRENT_LIST_DIR}/hand_builder_test.cpp LINK softhand_hand_builder softhand_model)
endif()
