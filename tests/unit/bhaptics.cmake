softhand_test(bhaptics ${CMAKE_CURRENT_LIST_DIR}/bhaptics_test.cpp LINK softhand_tactile_bhaptics)
