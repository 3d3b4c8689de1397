# Three hosts with a bad network between them, and their clocks. The hosts are namespaces. Where they are not permitted
# the test is skipped and says why.
if(SOFTHAND_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Debug")
  return()
endif()
add_executable(forwarder ${PROJECT_SOURCE_DIR}/tests/support/forwarder.cpp)
target_link_libraries(forwarder PRIVATE softhand_options)
find_program(PYTHON3 python3 REQUIRED)
add_test(NAME several_hosts COMMAND ${SOFTHAND_LIVE_TEST} ${PYTHON3} ${CMAKE_CURRENT_LIST_DIR}/hosts_test.py
  ${PROJECT_BINARY_DIR}/bin $<TARGET_FILE:forwarder> $<TARGET_FILE:bus_peer> $<TARGET_FILE:cyclone_peer>)
set_tests_properties(several_hosts PROPERTIES RUN_SERIAL TRUE TIMEOUT 240 SKIP_RETURN_CODE 77)
