# softhand-tracker-leap as a process: its simulator's messages, or a library in place of LeapC, in; DDS out.
if(TARGET softhand-tracker-leap)
  add_library(stand_in_leapc SHARED ${CMAKE_CURRENT_LIST_DIR}/stand_in_leapc.cpp)
  target_link_libraries(stand_in_leapc PRIVATE softhand_options)
  target_include_directories(stand_in_leapc PRIVATE ${PROJECT_SOURCE_DIR}/services)
  softhand_test(leap_process LIVE ${CMAKE_CURRENT_LIST_DIR}/leap_process_test.cpp LINK softhand_bus softhand_runtime
    softhand_tracker_leap softhand_simulated_service)
  target_compile_definitions(test_leap_process PRIVATE SOFTHAND_PROGRAMS="${PROJECT_BINARY_DIR}/bin"
    STAND_IN_LEAPC="$<TARGET_FILE:stand_in_leapc>")
  add_dependencies(test_leap_process softhand-tracker-leap simulate-tracker-leap stand_in_leapc)
endif()
