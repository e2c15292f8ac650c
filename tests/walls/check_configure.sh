#!/usr/bin/env bash
# A target that breaks an arrow stops the configure step, with a line that names the wall.
set -u
tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
echo 'int one() { return 1; }' >"$tree/one.cpp"
try() {  # try CMAKE_LINES EXPECTED
  cat >"$tree/CMakeLists.txt" <<END
cmake_minimum_required(VERSION 3.25)
project(walls LANGUAGES CXX)
add_library(lumigrid_flags INTERFACE)
foreach(t base sampling lod_patch_builder client metis)
  add_library(\${t} STATIC one.cpp)
endforeach()
include($1/cmake/LumigridTargets.cmake)
$2
lumigrid_check_walls()
END
  rm -rf "$tree/build"
  out=$(cmake -G Ninja -S "$tree" -B "$tree/build" 2>&1)
  status=$?
  if [ "$3" = ok ]; then [ $status -eq 0 ] || { echo "$out"; exit 1; }; return; fi
  [ $status -ne 0 ] && printf '%s' "$out" | tr '\n' ' ' | tr -s ' ' | grep -q "$3" && return
  echo "expected '$3', got status $status: $out"
  exit 1
}
try "$1" 'lumigrid_library(protocol SOURCES one.cpp USES base sampling)' ok
try "$1" 'lumigrid_library(protocol SOURCES one.cpp USES base lod_patch_builder)' \
  "wall: target 'protocol' must not use 'lod_patch_builder'"
try "$1" 'lumigrid_library(protocol SOURCES one.cpp USES base LIBRARIES metis)' \
  "wall: target 'protocol' must not link 'metis'"
try "$1" 'lumigrid_library(unheard_of SOURCES one.cpp)' "wall: target 'unheard_of' has no row"
try "$1" 'target_link_libraries(client PUBLIC metis)' "wall: the thin client 'client' reaches 'metis'"
try "$1" 'lumigrid_check_rows()' \
  "wall: the row of 'base_gl' in cmake/LumigridTargets.cmake is for a target that is not there"
