# Run by the test loop_status: cmake -DSOURCE=... -DBINARY=... -P check_loop_status.cmake
# What softhand_loop_status (idl/loop_status.cmake) refuses. With -DIDL=... this file calls it.
cmake_minimum_required(VERSION 3.25)
if(IDL)
  include(${SOURCE}/idl/loop_status.cmake)
  softhand_loop_status(${IDL} ${BINARY})
  return()
endif()

# Writes the struct with a field in its second line. The message must match the expression.
function(check field expected)
  file(WRITE ${BINARY}/bad.idl "@final struct LoopStatus {\n  ${field}\n};\n")
  execute_process(COMMAND ${CMAKE_COMMAND} -DSOURCE=${SOURCE} -DBINARY=${BINARY} -DIDL=${BINARY}/bad.idl
                  -P ${CMAKE_CURRENT_FUNCTION_LIST_FILE} RESULT_VARIABLE result ERROR_VARIABLE output)
  string(REGEX REPLACE "[ \n]+" " " output "${output}")  # CMake breaks the lines of a message.
  if(expected AND (result EQUAL 0 OR NOT output MATCHES "${expected}"))
    message(SEND_ERROR "'${field}': expected '${expected}', got '${output}'")
  elseif(NOT expected AND NOT result EQUAL 0)
    message(SEND_ERROR "'${field}': ${output}")
  endif()
endfunction()
check("uint64 steps; /* a good field; with [ and ; in its comment */" "")
check("float residual;" "bad.idl:2: a field of LoopStatus cannot have the type 'float'")
check("sequence<NamedValue, softhand::v1::MAX_OTHERS> others;" "bad.idl:2: .* type 'sequence<.*MAX_OTHERS>'")
check("double a_name_of_thirty_two_characters_;" "bad.idl:2: 'a_name_of_thirty_two_characters_' is longer than 31")
check("double residual" "bad.idl:2: expected 'TYPE NAME;'")
check("double residual; /* of two" "bad.idl:2: expected 'TYPE NAME;'")
