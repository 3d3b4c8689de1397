# The trackers that listen to sockets, as processes: they receive frames over real sockets and send skeletons over DDS.
if(NOT TARGET softhand-tracker-webxr)
  return()
endif()
softhand_test(socket_tracker_processes LIVE ${CMAKE_CURRENT_LIST_DIR}/socket_trackers_test.cpp LINK softhand_bus
  softhand_runtime softhand_model)
target_compile_definitions(test_socket_tracker_processes PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
add_dependencies(test_socket_tracker_processes softhand-tracker-webxr softhand-tracker-landmarks)
