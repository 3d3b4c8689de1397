# The shipped scenes through all loops on the virtual clock. Minutes of computing: one that a sanitizer or no optimiser would make of hours.
if(SOFTHAND_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Debug")
  return()
endif()
softhand_test(grasp ${CMAKE_CURRENT_LIST_DIR}/grasp_test.cpp LINK softhand_virtual_rig)
