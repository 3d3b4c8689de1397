# cmake --install installs the driver SDK: the libraries behind the main of a driver, the headers, and the CMake package
# softhand with softhand_driver(). Drivers outside this repository build against it (docs/add-a-tracker.md).
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

# All targets of ours that drivers and their simulators need.
set(sdk)
set(waiting softhand_tracker_service)
foreach(target softhand_websocket_client softhand_simulated_service)
  if(TARGET ${target})
    list(APPEND waiting ${target})
  endif()
endforeach()
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

# The headers must mean the same in a driver as in the libraries. With -mavx, for example, Eigen would choose a larger
# alignment, so that a hand has another size.
foreach(target ${sdk})
  target_compile_features(${target} INTERFACE cxx_std_20)
  target_compile_definitions(${target} INTERFACE $<INSTALL_INTERFACE:EIGEN_MAX_ALIGN_BYTES=16>
                             $<INSTALL_INTERFACE:EIGEN_NO_AUTOMATIC_RESIZING>)
endforeach()

set(package ${CMAKE_INSTALL_LIBDIR}/cmake/softhand)
install(TARGETS ${sdk} EXPORT softhand ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}/softhand)
install(EXPORT softhand FILE softhand-targets.cmake DESTINATION ${package})
# The headers of drivers stay here, except of those that a scene describes itself.
install(DIRECTORY common/ services/ DESTINATION include/softhand FILES_MATCHING PATTERN "*.hpp"
        REGEX "/services/(trackers|haptics|tactile)$" EXCLUDE)
foreach(folder trackers/replay haptics/log tactile/log)
  install(DIRECTORY services/${folder}/ DESTINATION include/softhand/${folder} FILES_MATCHING PATTERN "*.hpp")
endforeach()
install(DIRECTORY ${SOFTHAND_GENERATED}/ DESTINATION include/softhand)
file(WRITE ${PROJECT_BINARY_DIR}/softhand-config.cmake [[
include(CMakeFindDependencyMacro)
foreach(dependency Threads Eigen3 nlohmann_json tomlplusplus fmt fastcdr fastrtps CLI11 Bullet)
  find_dependency(${dependency})
endforeach()
find_dependency(OpenSSL COMPONENTS Crypto)
include(${CMAKE_CURRENT_LIST_DIR}/softhand-targets.cmake)
include(${CMAKE_CURRENT_LIST_DIR}/driver.cmake)
]])
# A driver must come from the same version: the wire and the options have no promise of compatibility yet. All commits
# before the first release have one number, so modules also compare their topics (docs/topics.md).
write_basic_package_version_file(${PROJECT_BINARY_DIR}/softhand-config-version.cmake COMPATIBILITY ExactVersion)
install(FILES ${PROJECT_BINARY_DIR}/softhand-config.cmake ${PROJECT_BINARY_DIR}/softhand-config-version.cmake
              services/service/driver.cmake DESTINATION ${package})
# The test of the SDK installs it after these are built.
add_custom_target(softhand_sdk DEPENDS ${sdk})
