softhand_test(tracking ${CMAKE_CURRENT_LIST_DIR}/tracking_test.cpp ${CMAKE_CURRENT_LIST_DIR}/tracking_input_test.cpp
  LINK softhand_tracking)
