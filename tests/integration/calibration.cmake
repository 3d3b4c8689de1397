# `softhand calibrate` with a replayed person, and the processes that use what it wrote. In real time, as in rig.cmake.
if(SOFTHAND_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Debug")
  return()
endif()
add_executable(test_calibration_process ${CMAKE_CURRENT_LIST_DIR}/calibration_process_test.cpp)
target_link_libraries(test_calibration_process PRIVATE softhand_options softhand_rig_harness softhand_runtime
  softhand_device softhand_tracker_replay GTest::gtest GTest::gtest_main)
target_compile_definitions(test_calibration_process PRIVATE SOFTHAND_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
add_dependencies(test_calibration_process softhand softhand-hand softhand-tracking softhand-tracker-replay)
gtest_discover_tests(test_calibration_process DISCOVERY_MODE PRE_TEST PROPERTIES RUN_SERIAL TRUE TIMEOUT 180)
