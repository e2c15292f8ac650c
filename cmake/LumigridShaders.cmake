# lumigrid_shaders(TARGET FOLDER FILE.glsl...): makes GLSL files constants of C++.
#
# FOLDER is the target's folder in the source tree, FILEs lie in its subfolder shaders/. The function writes the header
# "FOLDER/shaders.h", on the target's include path, with a constant for each file: splat_vertex.glsl becomes
# glsl::kSplatVertex. Shaders with variants get their #defines in front of it, in C++. Comments stay out, since the page
# would load them; their lines stay, empty, so that a GL's messages name the file's lines.
#
# The header is written while CMake configures, so that editors and checkers find it before anything is compiled. Each
# file is a dependency of the configure step: after an edit the next build configures again and recompiles what includes
# the header. A header whose text stays the same is not touched.
function(lumigrid_shaders target folder)
  set(header
    "#pragma once\n// Generated from ${folder}/shaders by cmake/LumigridShaders.cmake.\n\nnamespace glsl {\n\n")
  foreach(file IN LISTS ARGN)
    set(path ${PROJECT_SOURCE_DIR}/${folder}/shaders/${file})
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${path})
    file(READ ${path} text)
    string(REGEX REPLACE "[ \t]*//[^\n]*" "" text "${text}")
    _lumigrid_shader_constant(${file} constant)
    string(APPEND header "constexpr const char* ${constant} = R\"glsl(${text})glsl\";\n\n")
  endforeach()
  string(APPEND header "}  // namespace glsl\n")
  file(CONFIGURE OUTPUT ${CMAKE_BINARY_DIR}/shaders/${folder}/shaders.h CONTENT "${header}" @ONLY)
  target_include_directories(${target} PRIVATE ${CMAKE_BINARY_DIR}/shaders)
endfunction()

# splat_vertex.glsl -> kSplatVertex
function(_lumigrid_shader_constant file out)
  get_filename_component(stem ${file} NAME_WE)
  string(REPLACE "_" ";" words ${stem})
  set(constant k)
  foreach(word IN LISTS words)
    string(SUBSTRING ${word} 0 1 first)
    string(SUBSTRING ${word} 1 -1 rest)
    string(TOUPPER ${first} first)
    string(APPEND constant ${first}${rest})
  endforeach()
  set(${out} ${constant} PARENT_SCOPE)
endfunction()
