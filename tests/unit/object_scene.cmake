softhand_test(object_scene ${CMAKE_CURRENT_LIST_DIR}/object_scene_test.cpp
              LINK softhand_scene_file softhand_hand softhand_world)
