softhand_test(cli ${CMAKE_CURRENT_LIST_DIR}/cli_supervisor_test.cpp ${CMAKE_CURRENT_LIST_DIR}/cli_outcome_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/cli_files_test.cpp ${CMAKE_CURRENT_LIST_DIR}/cli_recording_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/cli_rig_lock_test.cpp ${CMAKE_CURRENT_LIST_DIR}/cli_modules_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/cli_trackers_test.cpp ${CMAKE_CURRENT_LIST_DIR}/cli_soft_outcome_test.cpp
  LINK softhand_supervisor softhand_outcome softhand_cli softhand_runtime)
