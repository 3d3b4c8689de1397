softhand_test(taxel_map ${CMAKE_CURRENT_LIST_DIR}/taxel_map_test.cpp LINK softhand_device)
