softhand_test(bus_network ${CMAKE_CURRENT_LIST_DIR}/bus_network_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/bus_definitions_test.cpp LINK softhand_bus)
