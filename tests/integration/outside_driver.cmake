# Drivers outside the repository build against the installed SDK, and one runs.
if(SOFTHAND_SANITIZE OR NOT TARGET softhand_sdk OR NOT TARGET softhand_websocket_client)
  return()
endif()
add_test(NAME outside_driver COMMAND bash ${PROJECT_SOURCE_DIR}/tests/outside_driver/check.sh ${PROJECT_SOURCE_DIR}
  ${PROJECT_BINARY_DIR})
set_tests_properties(outside_driver PROPERTIES TIMEOUT 300)
