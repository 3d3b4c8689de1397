softhand_test(add_an_energy ${CMAKE_CURRENT_LIST_DIR}/leash_test.cpp LINK softhand_energies)
