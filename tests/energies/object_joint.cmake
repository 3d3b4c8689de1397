softhand_test(object_joint ${CMAKE_CURRENT_LIST_DIR}/object_joint_test.cpp LINK softhand_solver softhand_energies)
