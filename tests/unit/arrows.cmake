softhand_test(arrows ${CMAKE_CURRENT_LIST_DIR}/arrows_test.cpp)
