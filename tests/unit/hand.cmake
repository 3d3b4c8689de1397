softhand_test(hand ${CMAKE_CURRENT_LIST_DIR}/hand_test.cpp LINK softhand_hand)
