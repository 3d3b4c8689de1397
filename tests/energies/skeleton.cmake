softhand_test(skeleton_energies
  ${CMAKE_CURRENT_LIST_DIR}/skeleton_inertia_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/skeleton_coupling_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/other_hands_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/skeleton_joint_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/skeleton_tissue_test.cpp
  LINK softhand_energies)
