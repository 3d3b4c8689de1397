softhand_test(sources ${CMAKE_CURRENT_LIST_DIR}/arrows_test.cpp ${CMAKE_CURRENT_LIST_DIR}/definitions_test.cpp)
