softhand_test(geometry ${CMAKE_CURRENT_LIST_DIR}/geometry_test.cpp LINK softhand_geometry)
