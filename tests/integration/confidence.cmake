# Joints in doubt while the hand holds an object, on the virtual clock.
if(SOFTHAND_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Debug")
  return()
endif()
softhand_test(confidence ${CMAKE_CURRENT_LIST_DIR}/confidence_test.cpp LINK softhand_virtual_rig)
