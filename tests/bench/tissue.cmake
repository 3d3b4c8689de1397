find_package(benchmark REQUIRED)
softhand_program(bench_tissue ${CMAKE_CURRENT_LIST_DIR}/tissue_bench.cpp
                 LINK softhand_energies benchmark::benchmark benchmark::benchmark_main)
target_include_directories(bench_tissue PRIVATE ${PROJECT_SOURCE_DIR}/tests)
