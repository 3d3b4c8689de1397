softhand_test(model ${CMAKE_CURRENT_LIST_DIR}/model_test.cpp LINK softhand_model)
