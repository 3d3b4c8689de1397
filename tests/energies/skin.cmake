softhand_test(skin_contact ${CMAKE_CURRENT_LIST_DIR}/skin_contact_test.cpp LINK softhand_energies)
