softhand_test(geometry ${CMAKE_CURRENT_LIST_DIR}/geometry_test.cpp LINK softhand_geometry)
softhand_test(distance_grid ${CMAKE_CURRENT_LIST_DIR}/distance_grid_test.cpp LINK softhand_geometry)
softhand_test(definitions ${CMAKE_CURRENT_LIST_DIR}/definitions_test.cpp)
