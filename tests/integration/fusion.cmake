# softhand-tracker-fusion as a process: hands of other trackers over DDS in, one hand out.
softhand_test(fusion_process ${CMAKE_CURRENT_LIST_DIR}/fusion_process_test.cpp LINK softhand_bus softhand_runtime
  softhand_tracker_replay)
target_compile_definitions(test_fusion_process PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin")
add_dependencies(test_fusion_process softhand-tracker-fusion softhand-tracker-replay)
