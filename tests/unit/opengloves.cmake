softhand_test(opengloves ${CMAKE_CURRENT_LIST_DIR}/opengloves_test.cpp LINK softhand_haptic_opengloves)
