# What `softhand calibrate` measures, and the file that it writes.
softhand_test(calibration ${CMAKE_CURRENT_LIST_DIR}/calibration_test.cpp LINK softhand_device softhand_scene_file)
