# The conformance kit of the SDK, and the drivers of haptic and tactile devices against it (conformance_test.cpp in the
# folder of each driver). At the device the time is real.
get_property(drivers GLOBAL PROPERTY SOFTHAND_CONFORMANCE)
softhand_test(conformance FILTER Conformance.* ${CMAKE_CURRENT_LIST_DIR}/conformance_test.cpp
  LINK softhand_haptic_log softhand_tactile_log ${drivers})
softhand_test(conformance_at_device LIVE FILTER ConformanceAtDevice.* ${CMAKE_CURRENT_LIST_DIR}/conformance_test.cpp
  LINK softhand_haptic_log softhand_tactile_log ${drivers})
