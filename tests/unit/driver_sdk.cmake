softhand_test(driver_sdk ${CMAKE_CURRENT_LIST_DIR}/driver_sdk_test.cpp LINK softhand_device softhand_scene_file)
