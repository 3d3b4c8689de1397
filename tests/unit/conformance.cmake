# The drivers of haptic and tactile devices against the conformance kit of the SDK.
if(NOT SOFTHAND_SOCKET_TRACKERS)
  return()
endif()
softhand_test(conformance ${CMAKE_CURRENT_LIST_DIR}/conformance_test.cpp LINK softhand_haptic_log softhand_tactile_log
  softhand_haptic_opengloves softhand_haptic_haply softhand_tactile_bhaptics softhand_tactile_weart
  softhand_websocket_client softhand_scene_file)
target_compile_definitions(test_conformance PRIVATE DHD_STAND_IN="$<TARGET_FILE:dhd_stand_in>"
  HD_STAND_IN="$<TARGET_FILE:openhaptics_stand_in>")
add_dependencies(test_conformance dhd_stand_in openhaptics_stand_in)
