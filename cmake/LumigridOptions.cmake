# Compiler settings that every target shares.
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
if(EMSCRIPTEN)
  # Without exceptions, type information and locks around statics: the page's one thread, and as few bytes as can be.
  add_compile_options(-fno-exceptions -fno-rtti)
  # Browsers that know vectors know the other instructions, which need fewer bytes than what stands for them otherwise.
  add_compile_options(-msimd128 -mnontrapping-fptoint -msign-ext -mbulk-memory)
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
option(LUMIGRID_PMR "lumigrid build --methods pmr, by CGAL's triangulation, which brings lumigrid under GPL-3" OFF)
option(LUMIGRID_QUICK "Compile many files at once: a whole build takes half the time, a change to one file more" OFF)
option(LUMIGRID_WERROR "Treat warnings as errors" ON)
option(LUMIGRID_FUZZ "The fuzz targets of tests/fuzz alone, linked to libFuzzer (clang; see the preset fuzz)" OFF)
set(LUMIGRID_SANITIZE "" CACHE STRING "Sanitizers to build with, e.g. address,undefined or thread")

# Nobody asks errno about a square root, and with it none can be vectorised. Products are rounded before they are added,
# whatever the processor offers: builds on all machines give the same bytes, every reader computes the same spheres, and
# rays meet shared edges alike from both sides.
add_compile_options(-fno-math-errno -fno-trapping-math -ffp-contract=off)

add_library(lumigrid_flags INTERFACE)
target_compile_options(lumigrid_flags INTERFACE -Wall -Wextra -Wshadow -Wnon-virtual-dtor -Wold-style-cast -Wcast-qual
  -Wpedantic)
# lumigrid_without_warnings(WARNING...): turns off those of the warnings that the compiler knows. clang stops at others.
include(CheckCXXCompilerFlag)
function(lumigrid_without_warnings)
  set(CMAKE_REQUIRED_FLAGS -Werror)
  foreach(warning IN LISTS ARGN)
    # gcc accepts any -Wno-, so it is asked for the warning itself.
    string(MAKE_C_IDENTIFIER "LUMIGRID_WARNS_OF_${warning}" known)
    check_cxx_compiler_flag(-W${warning} ${known})
    if(${known})
      target_compile_options(lumigrid_flags INTERFACE -Wno-${warning})
    endif()
  endforeach()
endfunction()
if(NOT EMSCRIPTEN)
  # gcc 12 takes a literal plus a std::string for a copy onto itself (its bug 105651).
  lumigrid_without_warnings(restrict)
endif()
if(LUMIGRID_QUICK AND NOT EMSCRIPTEN)
  # gcc takes the grouped files for headers: a type with a member from an anonymous namespace would be a fault in one.
  # And a constant of one file may have the name of a local variable in another, which only gcc can tell apart from
  # two local variables.
  lumigrid_without_warnings(subobject-linkage shadow)
  check_cxx_compiler_flag(-Wshadow=local LUMIGRID_WARNS_OF_SHADOW_LOCAL)
  if(LUMIGRID_WARNS_OF_SHADOW_LOCAL)
    target_compile_options(lumigrid_flags INTERFACE -Wshadow=local)
  endif()
endif()
if(LUMIGRID_WERROR)
  target_compile_options(lumigrid_flags INTERFACE -Werror)
endif()
# glm: one meaning of its functions everywhere (zero-to-one depth is never used: OpenGL's −1..1).
target_compile_definitions(lumigrid_flags INTERFACE GLM_FORCE_EXPLICIT_CTOR GLM_ENABLE_EXPERIMENTAL)
target_include_directories(lumigrid_flags INTERFACE ${PROJECT_SOURCE_DIR})
if(LUMIGRID_SANITIZE)
  # gcc documents that sanitizers make these two warn where nothing is wrong.
  lumigrid_without_warnings(maybe-uninitialized stringop-overflow)
  if(LUMIGRID_SANITIZE MATCHES "thread")
    # gcc's thread sanitizer does not know fences; Asio does without them.
    lumigrid_without_warnings(tsan)
    target_compile_definitions(lumigrid_flags INTERFACE BOOST_ASIO_DISABLE_FENCED_BLOCK)
  endif()
  add_compile_options(-fsanitize=${LUMIGRID_SANITIZE} -fno-omit-frame-pointer)
  add_link_options(-fsanitize=${LUMIGRID_SANITIZE})
endif()
if(LUMIGRID_FUZZ)
  # libFuzzer follows inputs through all of our code, not only through the targets. A finding ends the run.
  add_compile_options(-fsanitize=fuzzer-no-link -fno-sanitize-recover=all)
endif()
