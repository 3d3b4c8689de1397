softhand_test(tissue ${CMAKE_CURRENT_LIST_DIR}/tissue_test.cpp ${CMAKE_CURRENT_LIST_DIR}/tissue_kernel_test.cpp
  LINK softhand_energies)
