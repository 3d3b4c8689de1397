# softhand_loop_status(IDL FOLDER): writes FOLDER/messages/loop_status.inc, the C++ of `struct LoopStatus` in IDL
# (status.idl): the struct, its visit_fields, and the units of its fields. A line of the struct is a comment or a field.
function(softhand_loop_status idl folder)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${idl})
  file(READ ${idl} rest)
  set(members "")
  set(visits "")
  set(units "")
  set(comment "")
  set(number 0)
  set(place before)
  # Not file(STRINGS): a semicolon or a bracket in a line would disturb a list of lines.
  while(place MATCHES "before|inside" AND rest MATCHES "^([^\n]*)\n")
    string(STRIP "${CMAKE_MATCH_1}" line)
    string(LENGTH "${CMAKE_MATCH_0}" length)
    string(SUBSTRING "${rest}" ${length} -1 rest)
    math(EXPR number "${number} + 1")
    if(line MATCHES "^const uint32 (MAX_[A-Z_]+) = ([0-9]+);$")
      set(${CMAKE_MATCH_1} ${CMAKE_MATCH_2})
    elseif(line STREQUAL "@final struct LoopStatus {")
      set(place inside)
    elseif(place STREQUAL "before")
      continue()
    elseif(line STREQUAL "};")
      set(place after)
    elseif(line MATCHES "^/\\* (.*) \\*/$")
      set(comment "${CMAKE_MATCH_1}")
    elseif(line MATCHES "^(@key )?([^;]+) ([a-z][a-z0-9_]*);( */\\* (.*) \\*/)?$")
      set(visit field)
      if(CMAKE_MATCH_1)
        set(visit key)
      endif()
      set(type "${CMAKE_MATCH_2}")
      set(name ${CMAKE_MATCH_3})
      string(STRIP "${comment} ${CMAKE_MATCH_5}" comment)

      set(cpp "")
      if(type MATCHES "^(Stamp|double)$")
        set(cpp ${type})
      elseif(type MATCHES "^uint(32|64)$")
        set(cpp std::${type}_t)
      elseif(type MATCHES "^string<([0-9]+)>$")
        math(EXPR size "${CMAKE_MATCH_1} + 1")
        set(cpp "std::array<char, ${size}>")
      elseif(type MATCHES "^sequence<NamedValue, softhand::v1::(MAX_[A-Z_]+)>$")
        set(bound ${${CMAKE_MATCH_1}})
        if(bound)
          set(cpp "BoundedVector<NamedValue, ${bound}>")
        endif()
      endif()
      if(NOT cpp)
        message(FATAL_ERROR "${idl}:${number}: a field of LoopStatus cannot have the type '${type}'")
      endif()
      string(LENGTH ${name} length)
      if(length GREATER 31)
        message(FATAL_ERROR "${idl}:${number}: '${name}' is longer than 31 characters, the name of a NamedValue")
      endif()
      # `module` is a keyword of IDL, but not of C++.
      string(REGEX REPLACE "^module_name$" "module" member ${name})
      if(comment)
        string(APPEND members "  /// ${comment}\n")
      endif()
      string(APPEND members "  ${cpp} ${member}{};\n")
      string(APPEND visits "  v.${visit}(\"${name}\", m.${member});\n")
      if(comment MATCHES "^(N|m|J)([ ,]|$)")
        string(TOLOWER ${CMAKE_MATCH_1} unit)
        string(APPEND units "  if (field == \"${name}\") return \"${unit}\";\n")
      endif()
      set(comment "")
    else()
      message(FATAL_ERROR "${idl}:${number}: expected 'TYPE NAME;' or a comment of one line, got '${line}'")
    endif()
  endwhile()
  if(NOT place STREQUAL "after")
    message(FATAL_ERROR "${idl}: '@final struct LoopStatus {' or its '};' is missing")
  endif()
  file(CONFIGURE OUTPUT ${folder}/messages/loop_status.inc @ONLY CONTENT
"// Written by idl/loop_status.cmake from idl/status.idl. messages.hpp includes it.

/// loop_status: every loop writes it at 10 Hz; key: module name.
struct LoopStatus {
${members}};

/// Calls v.key(name, field) for the key and v.field(name, field) for all other fields, with the names of the IDL.
template <typename V, typename M>
  requires std::is_same_v<std::remove_const_t<M>, LoopStatus>
constexpr void visit_fields(V&& v, M& m) {
${visits}}

/// The unit of a field of LoopStatus whose name does not end with it: n, m or j. Empty for other fields.
constexpr std::string_view unit_of_status(std::string_view field) {
${units}  return {};
}
")
endfunction()
