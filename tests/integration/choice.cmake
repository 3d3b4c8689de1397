# Rigs other than the demo, and the demo after a change of its scene and its tracker. Real processes, as in rig.cmake.
if(SOFTHAND_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Debug" OR NOT TARGET softhand-tracker-webxr)
  return()
endif()
softhand_test(choice LIVE ${CMAKE_CURRENT_LIST_DIR}/choice_test.cpp LINK softhand_rig_harness softhand_runtime
  PROPERTIES RUN_SERIAL TRUE TIMEOUT 120)
add_dependencies(test_choice softhand softhand-hand softhand-world softhand-tracking softhand-tracker-replay
  softhand-tracker-webxr softhand-tracker-landmarks
  softhand-haptic-log softhand-tactile-log)
