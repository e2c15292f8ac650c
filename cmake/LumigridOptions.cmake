# Compiler settings that every target shares.
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
if(EMSCRIPTEN)
  # Without exceptions, type information and locks around statics: the page's one thread, and as few bytes as can be.
  add_compile_options(-msimd128 -fno-exceptions -fno-rtti)
  # The page is the same wherever it was built, and names no folder of that machine.
  add_compile_options(-ffile-prefix-map=${PROJECT_SOURCE_DIR}/=)
else()
  set(CMAKE_POSITION_INDEPENDENT_CODE ON)
  # Nothing of ours is a shared library, whose functions others may put theirs in place of: calls may become part of
  # their callers.
  add_compile_options(-fno-semantic-interposition)
endif()

option(LUMIGRID_TESTS "Build the tests" ON)
option(LUMIGRID_BENCH "Build the benchmarks in tests/bench" ON)
option(LUMIGRID_COMPARE "Build lumigrid-compare, which needs OpenCV" ON)
option(LUMIGRID_VIDEO "lumigrid-compare with H.264 video, by a libavcodec that may bring x264 under GPL" ON)
option(LUMIGRID_QUICK "Compile many files at once: a whole build takes half the time, a change to one file more" OFF)
option(LUMIGRID_WERROR "Treat warnings as errors" ON)
set(LUMIGRID_SANITIZE "" CACHE STRING "Sanitizers to build with, e.g. address,undefined or thread")

# Nobody asks errno about a square root, and with it none can be vectorised. Products are rounded before they are added,
# whatever the processor offers: builds on all machines give the same bytes, every reader computes the same spheres, and
# rays meet shared edges alike from both sides.
add_compile_options(-fno-math-errno -fno-trapping-math -ffp-contract=off)

add_library(lumigrid_flags INTERFACE)
target_compile_options(lumigrid_flags INTERFACE -Wall -Wextra -Wshadow -Wnon-virtual-dtor -Wold-style-cast -Wcast-qual
  -Wpedantic)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  # gcc 12 takes a literal plus a std::string for a copy onto itself (its bug 105651).
  target_compile_options(lumigrid_flags INTERFACE -Wno-restrict)
endif()
if(LUMIGRID_QUICK AND NOT EMSCRIPTEN)
  # gcc takes the grouped files for headers: a type with a member from an anonymous namespace would be a fault in one.
  # And a constant of one file may have the name of a local variable in another.
  target_compile_options(lumigrid_flags INTERFACE -Wno-subobject-linkage -Wno-shadow -Wshadow=local)
endif()
if(LUMIGRID_WERROR)
  target_compile_options(lumigrid_flags INTERFACE -Werror)
endif()
# glm: one meaning of its functions everywhere (zero-to-one depth is never used: OpenGL's −1..1).
target_compile_definitions(lumigrid_flags INTERFACE GLM_FORCE_EXPLICIT_CTOR GLM_ENABLE_EXPERIMENTAL)
target_include_directories(lumigrid_flags INTERFACE ${PROJECT_SOURCE_DIR})
if(LUMIGRID_SANITIZE)
  # gcc documents that sanitizers make these two warn where nothing is wrong.
  target_compile_options(lumigrid_flags INTERFACE -Wno-maybe-uninitialized -Wno-stringop-overflow)
  if(LUMIGRID_SANITIZE MATCHES "thread")
    # gcc's thread sanitizer does not know fences; Asio does without them.
    target_compile_options(lumigrid_flags INTERFACE -Wno-tsan)
    target_compile_definitions(lumigrid_flags INTERFACE BOOST_ASIO_DISABLE_FENCED_BLOCK)
  endif()
  add_compile_options(-fsanitize=${LUMIGRID_SANITIZE} -fno-omit-frame-pointer)
  add_link_options(-fsanitize=${LUMIGRID_SANITIZE})
endif()
