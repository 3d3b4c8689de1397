# Callgrind counts the instructions, so the result does not depend on the machine's load. Only the shipped build is
# counted, because sanitized and debug builds have other counts.
find_program(VALGRIND valgrind)
find_path(VALGRIND_INCLUDE valgrind/callgrind.h)
if(VALGRIND AND VALGRIND_INCLUDE AND CMAKE_BUILD_TYPE STREQUAL Release AND NOT SOFTHAND_SANITIZE)
  add_executable(counted_work ${CMAKE_CURRENT_LIST_DIR}/counted_work.cpp)
  target_include_directories(counted_work PRIVATE ${PROJECT_SOURCE_DIR}/tests ${VALGRIND_INCLUDE})
  target_link_libraries(counted_work PRIVATE softhand_options softhand_hand softhand_flight)
  target_compile_definitions(counted_work PRIVATE SOFTHAND_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
  softhand_test(step_cost ${CMAKE_CURRENT_LIST_DIR}/step_cost_test.cpp LINK softhand_options)
  add_dependencies(test_step_cost counted_work)
  target_compile_definitions(test_step_cost PRIVATE SOFTHAND_COUNTED_WORK="$<TARGET_FILE:counted_work>"
                             SOFTHAND_VALGRIND="${VALGRIND}")
endif()
