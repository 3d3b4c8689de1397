# cmake --install installs the driver SDK: the libraries behind the main of a driver, the headers, and the CMake package
# softhand with softhand_driver(). Drivers outside this repository build against it (docs/add-a-tracker.md).
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

# All targets of ours that softhand_tracker_service needs.
set(sdk)
set(waiting softhand_tracker_service)
while(waiting)
  list(POP_FRONT waiting target)
  list(APPEND sdk ${target})
  get_target_property(links ${target} INTERFACE_LINK_LIBRARIES)
  string(REGEX MATCHALL "softhand_[a-z_]+" links "${links}")
  foreach(link ${links})
    if(NOT link IN_LIST sdk AND NOT link IN_LIST waiting)
      list(APPEND waiting ${link})
    endif()
  endforeach()
endwhile()

set(package ${CMAKE_INSTALL_LIBDIR}/cmake/softhand)
install(TARGETS ${sdk} EXPORT softhand ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}/softhand)
install(EXPORT softhand FILE softhand-targets.cmake DESTINATION ${package})
install(DIRECTORY common/ services/ DESTINATION include/softhand FILES_MATCHING PATTERN "*.hpp")
install(DIRECTORY ${SOFTHAND_GENERATED}/ DESTINATION include/softhand)
file(WRITE ${PROJECT_BINARY_DIR}/softhand-config.cmake [[
include(CMakeFindDependencyMacro)
foreach(dependency Threads Eigen3 nlohmann_json tomlplusplus fmt fastcdr fastrtps CLI11)
  find_dependency(${dependency})
endforeach()
find_dependency(OpenSSL COMPONENTS Crypto)
include(${CMAKE_CURRENT_LIST_DIR}/softhand-targets.cmake)
include(${CMAKE_CURRENT_LIST_DIR}/driver.cmake)
]])
# A driver must come from the same version: the wire and the options have no promise of compatibility yet.
write_basic_package_version_file(${PROJECT_BINARY_DIR}/softhand-config-version.cmake COMPATIBILITY ExactVersion)
install(FILES ${PROJECT_BINARY_DIR}/softhand-config.cmake ${PROJECT_BINARY_DIR}/softhand-config-version.cmake
              services/service/driver.cmake DESTINATION ${package})
# The test of the SDK installs it after these are built.
add_custom_target(softhand_sdk DEPENDS ${sdk})
