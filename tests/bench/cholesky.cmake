find_package(benchmark REQUIRED)
find_package(BLAS REQUIRED)
softhand_program(bench_cholesky ${CMAKE_CURRENT_LIST_DIR}/cholesky_bench.cpp
                 LINK softhand_cholmod_solver softhand_solver softhand_energies softhand_model benchmark::benchmark
                 benchmark::benchmark_main ${BLAS_LIBRARIES})
target_include_directories(bench_cholesky PRIVATE ${PROJECT_SOURCE_DIR}/tests)
target_compile_definitions(bench_cholesky PRIVATE SOFTHAND_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
