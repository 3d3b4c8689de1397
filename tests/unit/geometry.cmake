softhand_test(geometry ${CMAKE_CURRENT_LIST_DIR}/geometry_test.cpp ${CMAKE_CURRENT_LIST_DIR}/distance_grid_test.cpp
  LINK softhand_geometry)
