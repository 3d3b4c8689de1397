if(TARGET softhand_web_server)
  softhand_test(web LIVE ${CMAKE_CURRENT_LIST_DIR}/web_test.cpp LINK softhand_web_server)
endif()
