find_package(benchmark REQUIRED)
softhand_program(bench_solver ${CMAKE_CURRENT_LIST_DIR}/solver_bench.cpp LINK softhand_solver softhand_energies benchmark::benchmark benchmark::benchmark_main)
target_include_directories(bench_solver PRIVATE ${PROJECT_SOURCE_DIR}/tests)
