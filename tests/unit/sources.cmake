# Rules that the sources themselves must follow: what may include what, and who may define what.
softhand_test(sources ${CMAKE_CURRENT_LIST_DIR}/arrows_test.cpp ${CMAKE_CURRENT_LIST_DIR}/definitions_test.cpp)
