softhand_test(osc ${CMAKE_CURRENT_LIST_DIR}/osc_test.cpp LINK softhand_tracker_osc softhand_tracker_replay)
