# softhand-haptic-opengloves as a process: its simulator's lines in, hands out, forces in, lines out.
softhand_test(opengloves_process ${CMAKE_CURRENT_LIST_DIR}/opengloves_process_test.cpp LINK softhand_bus
  softhand_runtime softhand_device)
target_compile_definitions(test_opengloves_process PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
add_dependencies(test_opengloves_process softhand-haptic-opengloves simulate-haptic-opengloves softhand-tracker-fusion)
