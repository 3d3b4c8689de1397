# The fuzzers of tests/fuzz (docs/fuzzing.md), a minute each. They keep the inputs that they found.
set(folder ${PROJECT_BINARY_DIR}/fuzz)
add_test(NAME fuzz_build COMMAND ${CMAKE_CTEST_COMMAND}
  --build-and-test ${PROJECT_SOURCE_DIR}/tests/fuzz ${folder} --build-generator Ninja --build-noclean
  --build-options -DCMAKE_CXX_COMPILER=clang++ --test-command ${folder}/write_seeds inputs)
# The build takes all cores. Beside it, tests of devices that have 50 ms to go to zero fail by chance.
set_tests_properties(fuzz_build PROPERTIES FIXTURES_SETUP fuzzers RUN_SERIAL TRUE TIMEOUT 900)
foreach(decoder topics hand_file object_file topic_recording hand_recording landmarks webxr page mesh_file
        streamer osc opengloves natnet vrpn leap leapc openxr packets haply bhaptics weart user_data flight message)
  add_test(NAME fuzz_${decoder} COMMAND ./fuzz_${decoder} -max_total_time=60 -timeout=10 -print_final_stats=1
    inputs/${decoder} WORKING_DIRECTORY ${folder})
  set_tests_properties(fuzz_${decoder} PROPERTIES FIXTURES_REQUIRED fuzzers TIMEOUT 180)
endforeach()
