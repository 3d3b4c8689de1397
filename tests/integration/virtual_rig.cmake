# The shipped scenes through all loops on the virtual clock. They compute for minutes. With a sanitizer or without
# optimisation they would take hours.
if(SOFTHAND_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Debug")
  return()
endif()
softhand_test(virtual_rig ${CMAKE_CURRENT_LIST_DIR}/confidence_test.cpp ${CMAKE_CURRENT_LIST_DIR}/grasp_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/joints_test.cpp ${CMAKE_CURRENT_LIST_DIR}/object_scenes_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/simulate_files_test.cpp ${CMAKE_CURRENT_LIST_DIR}/two_hands_test.cpp
  LINK softhand_virtual_rig)
