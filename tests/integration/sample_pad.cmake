# The sample of a tactile device in docs/add-a-device.md as a process.
softhand_test(sample_pad ${CMAKE_CURRENT_LIST_DIR}/sample_pad_test.cpp LINK softhand_bus softhand_runtime
  softhand_device)
target_compile_definitions(test_sample_pad PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
add_dependencies(test_sample_pad softhand-tactile-sample simulate-tactile-sample)
