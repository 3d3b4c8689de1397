softhand_test(solver ${CMAKE_CURRENT_LIST_DIR}/solver_test.cpp ${CMAKE_CURRENT_LIST_DIR}/newton_factor_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/linkage_test.cpp ${CMAKE_CURRENT_LIST_DIR}/local_newton_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/condensed_newton_test.cpp ${CMAKE_CURRENT_LIST_DIR}/factor_policy_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/bordered_solver_test.cpp ${CMAKE_CURRENT_LIST_DIR}/compliance_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/loose_blocks_test.cpp ${CMAKE_CURRENT_LIST_DIR}/block_cholesky_test.cpp LINK
  softhand_cholmod_solver softhand_solver softhand_energies softhand_model)
