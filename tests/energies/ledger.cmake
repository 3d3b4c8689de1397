softhand_test(energy_ledger ${CMAKE_CURRENT_LIST_DIR}/ledger_test.cpp LINK softhand_solver softhand_energies)
