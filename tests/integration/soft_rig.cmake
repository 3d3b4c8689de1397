# A flexible object in a rig of real processes, as in rig.cmake. With a sanitizer or without optimisation its hand would
# not keep up.
if(SOFTHAND_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Debug")
  return()
endif()
add_executable(test_soft_rig ${CMAKE_CURRENT_LIST_DIR}/soft_rig_test.cpp)
target_link_libraries(test_soft_rig PRIVATE softhand_options softhand_rig_harness softhand_runtime GTest::gtest
  GTest::gtest_main)
target_compile_definitions(test_soft_rig PRIVATE SOFTHAND_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
add_dependencies(test_soft_rig softhand softhand-hand softhand-world softhand-tracking softhand-tracker-replay
  softhand-haptic-log softhand-tactile-log)
gtest_discover_tests(test_soft_rig DISCOVERY_MODE PRE_TEST PROPERTIES RUN_SERIAL TRUE TIMEOUT 180)
