# A secured domain with both vendors: who has an identity, who is refused, and what is logged.
if(SOFTHAND_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Debug")
  return()
endif()
add_executable(bus_peer ${CMAKE_CURRENT_LIST_DIR}/bus_peer.cpp)
target_link_libraries(bus_peer PRIVATE softhand_options softhand_bus)
add_executable(cyclone_peer ${CMAKE_CURRENT_LIST_DIR}/cyclone_peer.c)
target_link_libraries(cyclone_peer PRIVATE softhand_idl_cyclone)
add_library(wall_clock MODULE ${PROJECT_SOURCE_DIR}/tests/support/wall_clock.cpp)
target_link_libraries(wall_clock PRIVATE softhand_options ${CMAKE_DL_LIBS})
find_program(PYTHON3 python3 REQUIRED)
add_test(NAME secured_domain COMMAND ${SOFTHAND_LIVE_TEST} ${PYTHON3} ${CMAKE_CURRENT_LIST_DIR}/security_test.py
  ${PROJECT_BINARY_DIR}/bin $<TARGET_FILE:bus_peer> $<TARGET_FILE:cyclone_peer> $<TARGET_FILE:wall_clock>)
set_tests_properties(secured_domain PROPERTIES RUN_SERIAL TRUE TIMEOUT 480 SKIP_RETURN_CODE 77)
