softhand_test(relaxation_energy ${CMAKE_CURRENT_LIST_DIR}/relaxation_test.cpp LINK softhand_energies)
