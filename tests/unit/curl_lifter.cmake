softhand_test(curl_lifter ${CMAKE_CURRENT_LIST_DIR}/curl_lifter_test.cpp LINK softhand_device)
