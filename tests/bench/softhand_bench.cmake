find_package(CLI11 2.1 REQUIRED)
find_package(fmt REQUIRED)
find_package(nlohmann_json 3.11 REQUIRED)
find_package(BLAS REQUIRED)
softhand_program(softhand-bench ${CMAKE_CURRENT_LIST_DIR}/softhand_bench.cpp
                 ${CMAKE_CURRENT_LIST_DIR}/pressing_costs.cpp ${CMAKE_CURRENT_LIST_DIR}/service_cost.cpp
                 LINK softhand_error_runtime softhand_report softhand_virtual_rig softhand_bus softhand_cholmod_solver
                 CLI11::CLI11 fmt::fmt nlohmann_json::nlohmann_json ${BLAS_LIBRARIES})
target_include_directories(softhand-bench PRIVATE ${PROJECT_SOURCE_DIR}/tests)
target_compile_definitions(softhand-bench PRIVATE SOFTHAND_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
# softhand-bench measures start and memory of these services.
add_dependencies(softhand-bench softhand-hand softhand-tracker-replay)
