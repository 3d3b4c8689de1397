find_package(fmt REQUIRED)
if(TARGET softhand_service)
  softhand_test(service LIVE ${CMAKE_CURRENT_LIST_DIR}/service_test.cpp LINK softhand_service fmt::fmt)
endif()
