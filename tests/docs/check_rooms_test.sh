#!/usr/bin/env bash
# tools/rooms.py --check passes for the picture of its table, and fails for the picture of another one.
set -eu
root=$(cd "$(dirname "$0")/../.." && pwd)
tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
sed 's/^_lumigrid_allow(protocol .*/_lumigrid_allow(protocol "base" "")/' "$root/cmake/LumigridTargets.cmake" >"$tree/other.cmake"
python3 "$root/tools/rooms.py" --table "$tree/other.cmake" --write "$tree/other.svg"
python3 "$root/tools/rooms.py" --table "$tree/other.cmake" --check "$tree/other.svg"
! python3 "$root/tools/rooms.py" --check "$tree/other.svg" 2>/dev/null || { echo "another table's picture passed"; exit 1; }
sed 's/^_lumigrid_allow(protocol .*/_lumigrid_allow(protocol "base;gone" "")/' "$root/cmake/LumigridTargets.cmake" >"$tree/gone.cmake"
! python3 "$root/tools/rooms.py" --table "$tree/gone.cmake" --write "$tree/gone.svg" 2>/dev/null ||
  { echo "a row that names a room which is not there passed"; exit 1; }
