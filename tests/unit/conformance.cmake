# The drivers of haptic and tactile devices against the conformance kit of the SDK.
softhand_test(conformance ${CMAKE_CURRENT_LIST_DIR}/conformance_test.cpp LINK softhand_haptic_log softhand_tactile_log
  softhand_haptic_opengloves softhand_scene_file)
