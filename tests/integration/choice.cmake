# Rigs other than the demo, and the demo after a change of its scene and its tracker. Real processes, as in rig.cmake.
if(SOFTHAND_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Debug" OR NOT TARGET softhand-tracker-webxr)
  return()
endif()
add_executable(test_choice ${CMAKE_CURRENT_LIST_DIR}/choice_test.cpp)
target_link_libraries(test_choice PRIVATE softhand_options softhand_rig_harness softhand_runtime GTest::gtest
  GTest::gtest_main)
target_compile_definitions(test_choice PRIVATE SOFTHAND_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
add_dependencies(test_choice softhand softhand-hand softhand-world softhand-tracking softhand-tracker-replay
  softhand-tracker-webxr softhand-tracker-landmarks
  softhand-haptic-log softhand-tactile-log)
gtest_discover_tests(test_choice DISCOVERY_MODE PRE_TEST PROPERTIES RUN_SERIAL TRUE TIMEOUT 120)
