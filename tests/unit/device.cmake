softhand_test(device ${CMAKE_CURRENT_LIST_DIR}/device_test.cpp ${CMAKE_CURRENT_LIST_DIR}/driver_sdk_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/curl_lifter_test.cpp ${CMAKE_CURRENT_LIST_DIR}/grounded_device_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/local_model_test.cpp ${CMAKE_CURRENT_LIST_DIR}/taxel_map_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/calibration_test.cpp LINK softhand_haptic_log softhand_tactile_log softhand_device
  softhand_scene_file softhand_model)
