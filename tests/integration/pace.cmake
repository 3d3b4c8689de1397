# Slow motion, pause, single steps and reset, with the demo's real processes. In real time, as in rig.cmake.
if(SOFTHAND_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Debug")
  return()
endif()
add_executable(test_pace ${CMAKE_CURRENT_LIST_DIR}/pace_test.cpp ${CMAKE_CURRENT_LIST_DIR}/rig_harness.cpp)
target_include_directories(test_pace PRIVATE ${PROJECT_SOURCE_DIR}/tests)
target_link_libraries(test_pace PRIVATE softhand_options softhand_bus softhand_runtime softhand_time_control
  GTest::gtest GTest::gtest_main)
target_compile_definitions(test_pace PRIVATE SOFTHAND_SOURCE_DIR="${PROJECT_SOURCE_DIR}"
  SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
add_dependencies(test_pace softhand softhand-hand softhand-world softhand-tracking softhand-tracker-replay
  softhand-haptic-log softhand-tactile-log)
gtest_discover_tests(test_pace DISCOVERY_MODE PRE_TEST PROPERTIES RUN_SERIAL TRUE TIMEOUT 120)
