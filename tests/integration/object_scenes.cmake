# The scenes with object files, through all loops on the virtual clock. With a sanitizer or without optimisation they
# would take hours.
if(SOFTHAND_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Debug")
  return()
endif()
softhand_test(object_scenes ${CMAKE_CURRENT_LIST_DIR}/object_scenes_test.cpp LINK softhand_virtual_rig)
