# Two hands with one object, through all loops on the virtual clock. With a sanitizer or without optimisation they would
# take hours.
if(SOFTHAND_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Debug")
  return()
endif()
softhand_test(two_hands ${CMAKE_CURRENT_LIST_DIR}/two_hands_test.cpp LINK softhand_virtual_rig)

# The same with real processes, as in rig.cmake.
add_executable(test_two_hands_rig ${CMAKE_CURRENT_LIST_DIR}/two_hands_rig_test.cpp)
target_link_libraries(test_two_hands_rig PRIVATE softhand_options softhand_rig_harness softhand_runtime GTest::gtest
  GTest::gtest_main)
target_compile_definitions(test_two_hands_rig PRIVATE SOFTHAND_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
add_dependencies(test_two_hands_rig softhand softhand-hand softhand-world softhand-tracking softhand-tracker-replay
  softhand-haptic-log)
gtest_discover_tests(test_two_hands_rig DISCOVERY_MODE PRE_TEST PROPERTIES RUN_SERIAL TRUE TIMEOUT 180)
