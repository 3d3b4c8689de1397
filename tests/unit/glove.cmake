# The simulated glove of `softhand simulate`, and the work of the wrenches.
softhand_test(glove ${CMAKE_CURRENT_LIST_DIR}/glove_test.cpp LINK softhand_virtual_rig)
