softhand_test(flight ${CMAKE_CURRENT_LIST_DIR}/flight_test.cpp LINK softhand_flight_repeat)
