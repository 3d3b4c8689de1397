softhand_test(grid_contact ${CMAKE_CURRENT_LIST_DIR}/grid_contact_test.cpp LINK softhand_scene)
