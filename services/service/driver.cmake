# softhand_driver(KIND NAME [LINK targets...] [CHECK_LINK targets...] [SIMULATOR_LINK targets...]): a driver in the
# current folder, in this repository or in a project that calls find_package(softhand). KIND is tracker, haptic or
# tactile. The files:
# - driver.cpp registers the options (device/driver.hpp). In this repository, `softhand` links it too, with the targets
#   of CHECK_LINK: those of LINK that the driver's checks need.
# - main.cpp becomes the program softhand-KIND-NAME.
# - simulator.cpp, if it exists, becomes the program simulate-KIND-NAME. In this repository it is built with the tests.
# - conformance_test.cpp, in this repository, tests a haptic or tactile driver with the conformance kit
#   (device/conformance.hpp). It is the target softhand_KIND_NAME_conformance.
function(softhand_driver kind name)
  cmake_parse_arguments(ARG "" "" "LINK;CHECK_LINK;SIMULATOR_LINK" ${ARGN})
  set(options softhand_${kind}_${name}_options)
  add_library(${options} OBJECT driver.cpp)
  target_link_libraries(${options} PRIVATE softhand_device ${ARG_CHECK_LINK})
  set_property(GLOBAL APPEND PROPERTY SOFTHAND_DRIVERS ${options})
  set_property(GLOBAL APPEND PROPERTY SOFTHAND_DRIVER_CHECKS ${ARG_CHECK_LINK})
  # This library has the mains of all kinds of drivers.
  set(links ${ARG_LINK} ${options} softhand_tracker_service)
  set(simulator_links ${ARG_LINK} ${ARG_SIMULATOR_LINK})
  set(has_simulator FALSE)
  if(EXISTS ${CMAKE_CURRENT_SOURCE_DIR}/simulator.cpp)
    set(has_simulator TRUE)
  endif()
  if(NOT COMMAND softhand_program)  # another project
    add_executable(softhand-${kind}-${name} main.cpp)
    target_link_libraries(softhand-${kind}-${name} PRIVATE ${links})
    if(has_simulator)
      add_executable(simulate-${kind}-${name} simulator.cpp)
      target_compile_features(simulate-${kind}-${name} PRIVATE cxx_std_20)
      target_link_libraries(simulate-${kind}-${name} PRIVATE ${simulator_links})
    endif()
    return()
  endif()
  target_link_libraries(${options} PRIVATE softhand_options)
  if(TARGET softhand_service)
    softhand_program(softhand-${kind}-${name} main.cpp LINK ${links})
  endif()
  if(has_simulator AND SOFTHAND_TESTS)
    softhand_program(simulate-${kind}-${name} OFFLINE simulator.cpp LINK ${simulator_links})
    target_compile_definitions(simulate-${kind}-${name} PRIVATE SOFTHAND_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
  endif()
  if(NOT kind STREQUAL "tracker" AND SOFTHAND_TESTS)
    set(test softhand_${kind}_${name}_conformance)
    add_library(${test} OBJECT conformance_test.cpp)
    target_include_directories(${test} PRIVATE ${PROJECT_SOURCE_DIR}/tests)
    target_link_libraries(${test} PUBLIC softhand_options softhand_device softhand_model ${simulator_links}
                          GTest::gtest)
    target_compile_definitions(${test} PRIVATE SOFTHAND_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
    target_compile_options(${test} PRIVATE $<$<CONFIG:Release>:-O1>)
    set_property(GLOBAL APPEND PROPERTY SOFTHAND_CONFORMANCE ${test})
  endif()
endfunction()
