if(TARGET softhand_websocket_client)
  softhand_test(websocket_client LIVE ${CMAKE_CURRENT_LIST_DIR}/websocket_client_test.cpp LINK softhand_websocket_client
    softhand_simulated_service)
endif()
