softhand_test(world ${CMAKE_CURRENT_LIST_DIR}/world_test.cpp LINK softhand_world)
