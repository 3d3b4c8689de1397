softhand_test(weart ${CMAKE_CURRENT_LIST_DIR}/weart_test.cpp LINK softhand_tactile_weart)
