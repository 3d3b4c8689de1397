if(TARGET softhand_viewer_frames)
  softhand_test(viewer_frames ${CMAKE_CURRENT_LIST_DIR}/viewer_frames_test.cpp LINK softhand_viewer_frames)
endif()
