# The wire: our codec is compared with the IDL text and with Fast's generator. Our DDS layer is tested with itself, with
# killed processes and with Cyclone DDS.
softhand_test(bus_wire ${CMAKE_CURRENT_LIST_DIR}/bus_wire_test.cpp LINK softhand_bus softhand_idl_fast)
target_compile_definitions(test_bus_wire PRIVATE ENABLE_OLD_LOG_MACROS_=0)

add_executable(bus_publisher ${CMAKE_CURRENT_LIST_DIR}/bus_publisher.cpp)
target_link_libraries(bus_publisher PRIVATE softhand_options softhand_bus)
add_executable(cyclone_subscriber ${CMAKE_CURRENT_LIST_DIR}/cyclone_subscriber.c)
target_link_libraries(cyclone_subscriber PRIVATE softhand_idl_cyclone)

softhand_test(bus LIVE ${CMAKE_CURRENT_LIST_DIR}/bus_test.cpp ${CMAKE_CURRENT_LIST_DIR}/bus_admission_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/bus_cyclone_test.cpp ${CMAKE_CURRENT_LIST_DIR}/bus_versions_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/bus_writers_test.cpp ${PROJECT_SOURCE_DIR}/tests/support/wall_clock.cpp LINK softhand_bus)
add_dependencies(test_bus bus_publisher cyclone_subscriber)
target_compile_definitions(test_bus PRIVATE BUS_PUBLISHER="$<TARGET_FILE:bus_publisher>"
  CYCLONE_SUBSCRIBER="$<TARGET_FILE:cyclone_subscriber>")
