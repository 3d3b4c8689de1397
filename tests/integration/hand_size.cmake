# The hand's service with hand.model = "auto". In real time, as in rig.cmake.
if(SOFTHAND_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Debug")
  return()
endif()
add_executable(test_auto_hand ${CMAKE_CURRENT_LIST_DIR}/hand_size_test.cpp)
target_link_libraries(test_auto_hand PRIVATE softhand_options softhand_rig_harness softhand_runtime GTest::gtest
  GTest::gtest_main)
add_dependencies(test_auto_hand softhand softhand-hand)
gtest_discover_tests(test_auto_hand DISCOVERY_MODE PRE_TEST PROPERTIES RUN_SERIAL TRUE TIMEOUT 60)
