# Whole rigs of real processes, and readers of their topics. `softhand report stress` also uses this library.
softhand_library(rig_harness ${CMAKE_CURRENT_LIST_DIR}/rig_harness.cpp LINK softhand_bus)
target_include_directories(softhand_rig_harness PUBLIC ${PROJECT_SOURCE_DIR}/tests)
target_compile_definitions(softhand_rig_harness PUBLIC SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin"
  PRIVATE SOFTHAND_SOURCE_DIR="${PROJECT_SOURCE_DIR}")

# The processes start, survive the death of each process, refuse a tracker's faults, and answer messages. These tests
# run in real time: one at a time, and only in a build that is fast enough.
if(SOFTHAND_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Debug")
  return()
endif()
softhand_test(rig LIVE ${CMAKE_CURRENT_LIST_DIR}/rig_test.cpp ${CMAKE_CURRENT_LIST_DIR}/rig_processes_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/rig_swap_test.cpp ${CMAKE_CURRENT_LIST_DIR}/flight_rig_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/soft_rig_test.cpp ${CMAKE_CURRENT_LIST_DIR}/two_hands_rig_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/hand_size_test.cpp ${CMAKE_CURRENT_LIST_DIR}/pace_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/calibration_process_test.cpp LINK softhand_rig_harness softhand_runtime softhand_device
  softhand_time_control softhand_tracker_replay PROPERTIES RUN_SERIAL TRUE TIMEOUT 180)
add_dependencies(test_rig softhand softhand-hand softhand-world softhand-tracking softhand-tracker-replay
  softhand-haptic-log softhand-tactile-log)
