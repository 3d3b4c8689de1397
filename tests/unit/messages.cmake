softhand_test(age ${CMAKE_CURRENT_LIST_DIR}/age_test.cpp LINK softhand_runtime)
