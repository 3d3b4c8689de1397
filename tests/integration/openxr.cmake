# softhand-tracker-openxr as a process: the real loader with a runtime of our own in, DDS out.
if(TARGET softhand-tracker-openxr)
  add_library(fake_openxr_runtime SHARED ${CMAKE_CURRENT_LIST_DIR}/fake_openxr_runtime.cpp)
  target_link_libraries(fake_openxr_runtime PRIVATE softhand_options)
  set(manifest ${CMAKE_CURRENT_BINARY_DIR}/fake_openxr_runtime.json)
  file(GENERATE OUTPUT ${manifest} CONTENT
    "{\"file_format_version\":\"1.0.0\",\"runtime\":{\"library_path\":\"$<TARGET_FILE:fake_openxr_runtime>\"}}\n")
  softhand_test(openxr_process LIVE ${CMAKE_CURRENT_LIST_DIR}/openxr_process_test.cpp LINK softhand_bus softhand_runtime
    softhand_device)
  target_compile_definitions(test_openxr_process PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin"
    OPENXR_MANIFEST="${manifest}")
  add_dependencies(test_openxr_process softhand-tracker-openxr fake_openxr_runtime)
endif()
