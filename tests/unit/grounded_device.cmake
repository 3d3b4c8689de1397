softhand_test(grounded_device ${CMAKE_CURRENT_LIST_DIR}/grounded_device_test.cpp LINK softhand_device softhand_model)
