# What drivers of gloves, pads and grounded devices read and write, without a process.
softhand_test(device_protocols ${CMAKE_CURRENT_LIST_DIR}/bhaptics_test.cpp ${CMAKE_CURRENT_LIST_DIR}/haply_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/opengloves_test.cpp ${CMAKE_CURRENT_LIST_DIR}/weart_test.cpp LINK softhand_haptic_haply
  softhand_haptic_opengloves softhand_tactile_bhaptics softhand_tactile_weart)
