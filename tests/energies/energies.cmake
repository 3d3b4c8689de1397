softhand_test(energies ${CMAKE_CURRENT_LIST_DIR}/skeleton_contact_test.cpp ${CMAKE_CURRENT_LIST_DIR}/contact_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/contact_derivatives_test.cpp ${CMAKE_CURRENT_LIST_DIR}/contact_plane_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/friction_test.cpp ${CMAKE_CURRENT_LIST_DIR}/sharp_point_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/ledger_test.cpp ${CMAKE_CURRENT_LIST_DIR}/object_joint_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/node_coupling_test.cpp ${CMAKE_CURRENT_LIST_DIR}/relaxation_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/skeleton_inertia_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/skeleton_coupling_test.cpp ${CMAKE_CURRENT_LIST_DIR}/other_hands_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/skeleton_joint_test.cpp ${CMAKE_CURRENT_LIST_DIR}/skeleton_tissue_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/skin_contact_test.cpp ${CMAKE_CURRENT_LIST_DIR}/tissue_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/tissue_kernel_test.cpp LINK softhand_solver softhand_energies)
