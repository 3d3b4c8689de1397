# The writing rules of the tree: sentence length, line width, format and links. Then a test of that check itself.
find_program(PYTHON3 python3 REQUIRED)
add_test(NAME prose COMMAND ${PYTHON3} ${PROJECT_SOURCE_DIR}/tests/support/check_prose)
add_test(NAME prose_check COMMAND ${PYTHON3} ${PROJECT_SOURCE_DIR}/tests/support/check_prose_test.py)
