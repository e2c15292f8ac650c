# Flags that make a fault in native code end the program where it could otherwise be used against it. A compiler that
# lacks one goes without. The page is left alone: WebAssembly has its own bounds and no return addresses to overwrite.
# tests/walls/check_hardening.sh reads in the programs that the flags took effect; docs/decisions/hardened-builds.md
# has their cost.
include(CheckCXXCompilerFlag)
include(CheckCXXSourceCompiles)
include(CheckLinkerFlag)
include(CheckPIESupported)

option(LUMIGRID_HARDEN "Stack protector, checked library calls, full RELRO and the like in native builds" ON)

# lumigrid_compile_flag(FLAG): for all targets that follow, where the compiler knows it.
function(lumigrid_compile_flag flag)
  string(MAKE_C_IDENTIFIER "LUMIGRID_HAS${flag}" known)
  check_cxx_compiler_flag(${flag} ${known})
  if(${known})
    add_compile_options(${flag})
  endif()
endfunction()

function(lumigrid_link_flag flag)
  string(MAKE_C_IDENTIFIER "LUMIGRID_HAS${flag}" known)
  check_linker_flag(CXX ${flag} ${known})
  if(${known})
    add_link_options(${flag})
  endif()
endfunction()

# Level 3 also checks objects whose size is known only at run time. It needs gcc 12 or clang 9, and glibc 2.34, whose
# headers say so when they fall back.
function(lumigrid_fortify_level out)
  set(CMAKE_REQUIRED_FLAGS "-O2 -Werror")
  set(CMAKE_REQUIRED_DEFINITIONS -U_FORTIFY_SOURCE -D_FORTIFY_SOURCE=3)
  check_cxx_source_compiles("#include <cstring>\nint main() { return 0; }" LUMIGRID_HAS_FORTIFY_3)
  if(LUMIGRID_HAS_FORTIFY_3)
    set(${out} 3 PARENT_SCOPE)
  else()
    set(${out} 2 PARENT_SCOPE)
  endif()
endfunction()

function(lumigrid_harden_code)
  foreach(flag -fstack-protector-strong -fstack-clash-protection -fcf-protection=full)
    lumigrid_compile_flag(${flag})
  endforeach()
  # operator[] of the standard containers stops at an index that is out of range, front() at an empty one.
  add_compile_definitions(_GLIBCXX_ASSERTIONS)
  # With these checks in between, gcc 12 sees paths to std::fill that no program takes.
  lumigrid_without_warnings(stringop-overflow)
  # It works in optimised code only, and sanitizers see more of the calls as they are.
  if(NOT LUMIGRID_SANITIZE)
    lumigrid_fortify_level(level)
    add_compile_options($<$<CONFIG:Release,RelWithDebInfo,MinSizeRel>:-U_FORTIFY_SOURCE>
      $<$<CONFIG:Release,RelWithDebInfo,MinSizeRel>:-D_FORTIFY_SOURCE=${level}>)
  endif()
endfunction()

# Programs lie at random addresses, and their tables of functions are read-only once they run.
macro(lumigrid_harden_programs)
  check_pie_supported(LANGUAGES CXX)
  foreach(flag -Wl,-z,relro -Wl,-z,now -Wl,-z,noexecstack)
    lumigrid_link_flag(${flag})
  endforeach()
endmacro()

# lumigrid_trusted(target-or-file...): where time goes and no stranger's bytes are read: these get what others have
# checked, and do without checks of each index.
function(lumigrid_trusted)
  if(LUMIGRID_HARDEN AND NOT EMSCRIPTEN)
    foreach(name IN LISTS ARGN)
      if(TARGET ${name})
        target_compile_options(${name} PRIVATE -U_GLIBCXX_ASSERTIONS)
      else()
        set_property(SOURCE ${name} APPEND PROPERTY COMPILE_OPTIONS -U_GLIBCXX_ASSERTIONS)
      endif()
    endforeach()
  endif()
endfunction()

if(LUMIGRID_HARDEN AND NOT EMSCRIPTEN)
  lumigrid_harden_code()
  lumigrid_harden_programs()
endif()
