find_package(nlohmann_json 3.11 REQUIRED)
softhand_test(object_file ${CMAKE_CURRENT_LIST_DIR}/object_file_test.cpp
              LINK softhand_runtime softhand_geometry softhand_model nlohmann_json::nlohmann_json)
if(TARGET softhand_object_builder)
  softhand_test(object_builder ${CMAKE_CURRENT_LIST_DIR}/object_builder_test.cpp LINK softhand_object_builder)
endif()
# The committed files are what the script and the builder make.
if(TARGET softhand-build-object)
  find_program(PYTHON3 python3 REQUIRED)
  set(objects ${PROJECT_SOURCE_DIR}/config/objects)
  foreach(object die key button sponge_ball soft_cup)
    set(made ${PROJECT_BINARY_DIR}/objects/${object}.object.json)
    add_test(NAME object_script_${object}
             COMMAND sh -c "mkdir -p ${PROJECT_BINARY_DIR}/objects && ${PYTHON3} ${objects}/make_objects.py \
$<TARGET_FILE:softhand-build-object> --out ${PROJECT_BINARY_DIR}/objects ${object} && \
cmp ${made} ${objects}/${object}.object.json")
  endforeach()
endif()
