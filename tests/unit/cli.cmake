softhand_test(cli_supervisor ${CMAKE_CURRENT_LIST_DIR}/cli_supervisor_test.cpp LINK softhand_supervisor
  softhand_runtime)
softhand_test(cli_outcome ${CMAKE_CURRENT_LIST_DIR}/cli_outcome_test.cpp LINK softhand_outcome)
softhand_test(cli_files ${CMAKE_CURRENT_LIST_DIR}/cli_files_test.cpp LINK softhand_cli)
softhand_test(cli_recording ${CMAKE_CURRENT_LIST_DIR}/cli_recording_test.cpp LINK softhand_cli)
softhand_test(cli_rig_lock ${CMAKE_CURRENT_LIST_DIR}/cli_rig_lock_test.cpp LINK softhand_cli)
softhand_test(cli_modules ${CMAKE_CURRENT_LIST_DIR}/cli_modules_test.cpp LINK softhand_cli)
softhand_test(cli_trackers ${CMAKE_CURRENT_LIST_DIR}/cli_trackers_test.cpp LINK softhand_cli)
