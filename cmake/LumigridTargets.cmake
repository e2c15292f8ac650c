# The walls: which target may link which. docs/rooms.svg is drawn from this table by tools/rooms.py.
#
# lumigrid_library(NAME SOURCES file... USES target... [LIBRARIES outside...])
# lumigrid_program(NAME OUTPUT file SOURCES ... USES ... [LIBRARIES ...])
#
# USES names our own targets and is checked against LUMIGRID_MAY_USE_<name>; LIBRARIES names outside libraries and is
# checked against LUMIGRID_MAY_LINK_<name>. Anything not allowed stops the configure step. After all targets exist,
# lumigrid_check_walls() follows the links to their ends and stops when the thin client reaches a forbidden library, and
# lumigrid_check_rows() stops at a row whose target is not there.

# lumigrid_row(NAME [USES target...] [LINKS outside...]): what NAME may use and link; "*" is anything.
function(lumigrid_row name)
  cmake_parse_arguments(A "" "" "USES;LINKS" ${ARGN})
  list(APPEND LUMIGRID_ROWS ${name})
  set(LUMIGRID_ROWS "${LUMIGRID_ROWS}" PARENT_SCOPE)
  set(LUMIGRID_MAY_USE_${name} "${A_USES}" PARENT_SCOPE)
  set(LUMIGRID_MAY_LINK_${name} "${A_LINKS}" PARENT_SCOPE)
endfunction()

set(_any_base base base_gl base_egl base_hash base_http base_jpeg base_json base_png base_tls)
lumigrid_row(base LINKS glm::glm Threads::Threads)
lumigrid_row(base_gl USES base LINKS gles)
lumigrid_row(base_egl USES base base_gl LINKS egl)
lumigrid_row(base_hash USES base LINKS OpenSSL::Crypto)
lumigrid_row(base_http USES base LINKS CURL::libcurl)
lumigrid_row(base_jpeg USES base LINKS turbojpeg JPEG::JPEG)
lumigrid_row(base_json USES base base_hash LINKS nlohmann_json::nlohmann_json)
lumigrid_row(base_png USES base LINKS PNG::PNG)
lumigrid_row(base_tls USES base LINKS OpenSSL::SSL)
lumigrid_row(mesh
  USES base base_jpeg base_png
  LINKS turbojpeg libwebp draco meshoptimizer::meshoptimizer nlohmann_json::nlohmann_json)
lumigrid_row(lod_patch USES base)
lumigrid_row(lod_qsplat USES base)
lumigrid_row(lod_pmr USES base)
lumigrid_row(lod_hlod USES base lod_patch lod_pmr)
lumigrid_row(lod_texture USES base base_jpeg LINKS ZLIB::ZLIB)
lumigrid_row(lod_ingest USES base mesh)
lumigrid_row(lod_patch_builder USES base mesh lod_ingest lod_patch lod_texture LINKS metis)
lumigrid_row(lod_qsplat_builder USES base mesh lod_ingest lod_qsplat)
lumigrid_row(lod_hlod_builder USES base mesh lod_ingest lod_patch lod_patch_builder lod_hlod LINKS metis)
lumigrid_row(lod_pmr_builder USES base mesh lod_ingest lod_pmr LINKS CGAL::CGAL)
lumigrid_row(lod_draw USES base base_gl lod_patch lod_qsplat lod_pmr lod_hlod)
lumigrid_row(sampling USES base)
lumigrid_row(sampling_json USES base base_hash base_json sampling LINKS nlohmann_json::nlohmann_json)
lumigrid_row(cache USES base)
lumigrid_row(faces USES base)
lumigrid_row(face_image USES base base_jpeg faces LINKS libwebp)
lumigrid_row(frames USES base faces face_image)
lumigrid_row(packs USES base sampling)
lumigrid_row(objects USES base base_hash base_http)
lumigrid_row(repository
  USES base base_hash sampling sampling_json cache faces face_image packs objects
  LINKS lmdb nlohmann_json::nlohmann_json)
lumigrid_row(protocol USES base sampling)
lumigrid_row(plan USES base lod_patch sampling cache protocol)
lumigrid_row(server_render USES ${_any_base} lod_patch lod_qsplat lod_pmr lod_hlod lod_texture lod_draw)
lumigrid_row(client_render USES base base_gl lod_patch lod_draw)
lumigrid_row(server_views USES base base_json lod_patch sampling repository)
lumigrid_row(server_bake
  USES ${_any_base} lod_patch lod_draw sampling faces face_image frames repository protocol plan server_render
       server_views
  LINKS spdlog::spdlog)
lumigrid_row(server_export
  USES base base_jpeg base_json base_png lod_patch lod_texture LINKS nlohmann_json::nlohmann_json)
lumigrid_row(server_session USES base lod_patch sampling repository protocol plan)
lumigrid_row(server_scene
  USES base base_json lod_patch sampling faces packs objects repository protocol plan server_session
  LINKS Threads::Threads spdlog::spdlog)
lumigrid_row(server_trial
  USES base base_gl base_egl base_json lod_patch lod_draw sampling face_image repository protocol plan client
       server_render server_views server_bake server_session)
lumigrid_row(server_auth USES base base_hash base_json LINKS nlohmann_json::nlohmann_json)
lumigrid_row(server_log USES base LINKS Threads::Threads spdlog::spdlog nlohmann_json::nlohmann_json)
lumigrid_row(server_metrics USES base)
lumigrid_row(server_net
  USES ${_any_base} lod_patch lod_qsplat lod_draw sampling cache faces packs objects repository protocol plan
       server_auth server_render server_bake server_session server_scene server_log server_metrics
  LINKS Boost::headers Threads::Threads spdlog::spdlog nlohmann_json::nlohmann_json)
lumigrid_row(lumigrid
  USES ${_any_base} mesh lod_ingest lod_patch lod_patch_builder lod_qsplat lod_qsplat_builder lod_pmr lod_pmr_builder
       lod_hlod lod_hlod_builder lod_texture lod_draw sampling cache faces packs objects repository protocol
       server_auth server_render server_views server_bake server_export server_session server_scene server_trial
       server_net server_log server_metrics
  LINKS CLI11::CLI11 spdlog::spdlog nlohmann_json::nlohmann_json openmesh)
lumigrid_row(client
  USES base base_gl lod_patch lod_qsplat lod_pmr lod_hlod lod_draw sampling faces packs cache protocol plan
       client_render)
lumigrid_row(client_native
  USES ${_any_base} lod_patch lod_qsplat lod_pmr lod_hlod lod_draw sampling sampling_json cache faces packs frames
       protocol client
  LINKS Boost::headers Threads::Threads glfw imgui spdlog::spdlog nlohmann_json::nlohmann_json)
lumigrid_row(lumigrid-view
  USES ${_any_base} lod_patch lod_qsplat lod_pmr lod_hlod lod_draw sampling sampling_json cache faces packs protocol
       plan client client_native
  LINKS CLI11::CLI11 spdlog::spdlog nlohmann_json::nlohmann_json)
lumigrid_row(client_web
  USES base base_gl lod_patch lod_qsplat lod_draw sampling faces packs cache protocol plan client)
lumigrid_row(client_web_splats USES base base_gl lod_qsplat client)
lumigrid_row(client_web_umbrellas USES base base_gl lod_pmr client)
lumigrid_row(client_web_hlod USES base base_gl lod_hlod client)
lumigrid_row(client_web_decode USES base faces)
lumigrid_row(client_web_check USES base client)
lumigrid_row(compare USES * LINKS *)
lumigrid_row(lumigrid-compare USES * LINKS *)

set(LUMIGRID_CLIENT_FORBIDDEN metis openmesh draco opencv_core opencv_imgproc mesh lod_ingest lod_patch_builder
  lod_qsplat_builder lod_pmr_builder lod_hlod_builder CGAL::CGAL repository objects server_auth server_render
  server_views server_bake server_export server_session server_scene server_net server_log server_metrics lmdb)

function(_lumigrid_check_list kind name allowed)
  if("${allowed}" STREQUAL "*")
    return()
  endif()
  foreach(used IN LISTS ARGN)
    if(NOT used IN_LIST allowed)
      message(FATAL_ERROR
        "wall: target '${name}' must not ${kind} '${used}' (allowed: ${allowed}); see cmake/LumigridTargets.cmake")
    endif()
  endforeach()
endfunction()

function(_lumigrid_setup name uses libraries)
  if(NOT DEFINED LUMIGRID_MAY_USE_${name})
    message(FATAL_ERROR "wall: target '${name}' has no row in cmake/LumigridTargets.cmake")
  endif()
  _lumigrid_check_list("use" ${name} "${LUMIGRID_MAY_USE_${name}}" ${uses})
  _lumigrid_check_list("link" ${name} "${LUMIGRID_MAY_LINK_${name}}" ${libraries})
  target_link_libraries(${name} PUBLIC ${uses} ${libraries} PRIVATE lumigrid_flags)
  target_include_directories(${name} PUBLIC ${PROJECT_SOURCE_DIR})
  if(LUMIGRID_QUICK)
    lumigrid_quick(${name})
  endif()
endfunction()

# lumigrid_hot(file...): where time goes. A page's code is built for size (preset "web"), all but these. Beside -Oz the
# compiler driver says -fno-inline-functions, which outlives a later -O2: without inlining umbrellas take twice as long.
# (-O3 is no faster, and larger.)
function(lumigrid_hot)
  if(EMSCRIPTEN)
    set_property(SOURCE ${ARGN} APPEND PROPERTY COMPILE_OPTIONS -O2 -finline-functions)
  endif()
endfunction()

# lumigrid_cold(target...): code that waits for people, files or the network, and in quick builds the tests. Compiling
# it at -O1 takes two thirds of -O3's time.
function(lumigrid_cold)
  if(NOT EMSCRIPTEN)
    foreach(name IN LISTS ARGN)
      target_compile_options(${name} PRIVATE $<$<CONFIG:Release>:-O1>)
    endforeach()
  endif()
endfunction()

function(lumigrid_library name)
  cmake_parse_arguments(A "" "" "SOURCES;USES;LIBRARIES" ${ARGN})
  add_library(${name} STATIC ${A_SOURCES})
  _lumigrid_setup(${name} "${A_USES}" "${A_LIBRARIES}")
endfunction()

function(lumigrid_program name)
  cmake_parse_arguments(A "" "" "SOURCES;USES;LIBRARIES" ${ARGN})
  add_executable(${name} ${A_SOURCES})
  _lumigrid_setup(${name} "${A_USES}" "${A_LIBRARIES}")
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)
endfunction()

function(_lumigrid_reach name out)
  set(seen "")
  set(todo ${name})
  while(todo)
    list(POP_FRONT todo one)
    if(one IN_LIST seen OR NOT TARGET ${one})
      continue()
    endif()
    list(APPEND seen ${one})
    get_target_property(next ${one} INTERFACE_LINK_LIBRARIES)
    if(next)
      list(APPEND todo ${next})
    endif()
    get_target_property(type ${one} TYPE)
    if(NOT type STREQUAL "INTERFACE_LIBRARY")
      get_target_property(next ${one} LINK_LIBRARIES)
      if(next)
        list(APPEND todo ${next})
      endif()
    endif()
  endwhile()
  set(${out} "${seen}" PARENT_SCOPE)
endfunction()

function(lumigrid_check_walls)
  foreach(thin client client_native lumigrid-view client_web client_web_splats client_web_umbrellas client_web_hlod
      client_web_decode client_web_check)
    if(TARGET ${thin})
      _lumigrid_reach(${thin} reached)
      foreach(bad IN LISTS LUMIGRID_CLIENT_FORBIDDEN)
        if(bad IN_LIST reached)
          message(FATAL_ERROR
            "wall: the thin client '${thin}' reaches '${bad}'; it must link none of ${LUMIGRID_CLIENT_FORBIDDEN}")
        endif()
      endforeach()
    endif()
  endforeach()
endfunction()

# Rows of the page are for the preset "web" alone, those of lumigrid-compare and of CGAL's user for builds that have
# them.
function(lumigrid_check_rows)
  foreach(name IN LISTS LUMIGRID_ROWS)
    set(expected TRUE)
    if(EMSCRIPTEN OR name MATCHES "^client_web" OR (name MATCHES "compare$" AND NOT LUMIGRID_COMPARE)
       OR (name STREQUAL "lod_pmr_builder" AND NOT LUMIGRID_PMR))
      set(expected FALSE)
    endif()
    if(expected AND NOT TARGET ${name})
      message(FATAL_ERROR "wall: the row of '${name}' in cmake/LumigridTargets.cmake is for a target that is not there")
    endif()
  endforeach()
endfunction()
