softhand_test(world ${CMAKE_CURRENT_LIST_DIR}/world_test.cpp ${CMAKE_CURRENT_LIST_DIR}/world_joint_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/world_coupling_test.cpp ${CMAKE_CURRENT_LIST_DIR}/world_owner_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/physics_engine_test.cpp ${CMAKE_CURRENT_LIST_DIR}/world_descriptions_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/soft_copy_test.cpp ${CMAKE_CURRENT_LIST_DIR}/soft_coupling_test.cpp LINK
  softhand_world softhand_runtime)
