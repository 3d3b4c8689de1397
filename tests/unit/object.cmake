find_package(nlohmann_json 3.11 REQUIRED)
softhand_test(object_file ${CMAKE_CURRENT_LIST_DIR}/object_file_test.cpp
              LINK softhand_runtime softhand_geometry softhand_model nlohmann_json::nlohmann_json)
if(TARGET softhand_object_builder)
  softhand_test(object_builder ${CMAKE_CURRENT_LIST_DIR}/object_builder_test.cpp LINK softhand_object_builder)
endif()
