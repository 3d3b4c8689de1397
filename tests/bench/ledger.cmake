softhand_program(bench_ledger ${CMAKE_CURRENT_LIST_DIR}/ledger_bench.cpp LINK softhand_hand softhand_tracking)
target_include_directories(bench_ledger PRIVATE ${PROJECT_SOURCE_DIR}/tests)
