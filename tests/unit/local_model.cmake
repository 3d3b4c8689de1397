softhand_test(local_model ${CMAKE_CURRENT_LIST_DIR}/local_model_test.cpp LINK softhand_device)
