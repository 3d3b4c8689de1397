# The shipped scenes through all loops on the virtual clock. They compute for minutes. With a sanitizer or without
# optimisation they would take hours.
if(SOFTHAND_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Debug")
  return()
endif()
softhand_test(grasp ${CMAKE_CURRENT_LIST_DIR}/grasp_test.cpp LINK softhand_virtual_rig)
