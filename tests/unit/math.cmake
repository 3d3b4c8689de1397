softhand_test(math ${CMAKE_CURRENT_LIST_DIR}/math_test.cpp ${CMAKE_CURRENT_LIST_DIR}/helper_thread_test.cpp LINK
  softhand_math)
