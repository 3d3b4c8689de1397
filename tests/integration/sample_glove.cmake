# The sample driver of docs/add-a-device.md as a process.
softhand_test(sample_glove ${CMAKE_CURRENT_LIST_DIR}/sample_glove_test.cpp LINK softhand_bus softhand_runtime
  softhand_device)
target_compile_definitions(test_sample_glove PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
add_dependencies(test_sample_glove softhand-haptic-sample)
