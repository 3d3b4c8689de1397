softhand_test(contact_energies ${CMAKE_CURRENT_LIST_DIR}/contact_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/contact_derivatives_test.cpp ${CMAKE_CURRENT_LIST_DIR}/contact_plane_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/friction_test.cpp ${CMAKE_CURRENT_LIST_DIR}/sharp_point_test.cpp LINK softhand_energies)
