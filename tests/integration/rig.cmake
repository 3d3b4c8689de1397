# Whole rigs of real processes: they come up, survive the death of each, refuse a tracker's faults, answer messages. Real time: one at a time, and only
# of a build that keeps up with it.
if(SOFTHAND_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Debug")
  return()
endif()
add_executable(test_rig ${CMAKE_CURRENT_LIST_DIR}/rig_test.cpp ${CMAKE_CURRENT_LIST_DIR}/rig_harness.cpp)
target_include_directories(test_rig PRIVATE ${PROJECT_SOURCE_DIR}/tests)
target_link_libraries(test_rig PRIVATE softhand_options softhand_bus softhand_runtime GTest::gtest GTest::gtest_main)
target_compile_definitions(test_rig PRIVATE SOFTHAND_SOURCE_DIR="${PROJECT_SOURCE_DIR}" SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
add_dependencies(test_rig softhand softhand-hand softhand-world softhand-tracking softhand-tracker-replay softhand-haptic-log softhand-tactile-log)
gtest_discover_tests(test_rig DISCOVERY_MODE PRE_TEST PROPERTIES RUN_SERIAL TRUE TIMEOUT 120)
