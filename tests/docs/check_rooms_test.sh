#!/usr/bin/env bash
# tools/rooms.py --check passes for the picture of its table and fails for the picture of another one; a row that names
# a room which is not there is refused.
set -eu
root=$(cd "$(dirname "$0")/../.." && pwd)
tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
table=$root/cmake/LumigridTargets.cmake

fails() {  # fails MESSAGE ARGUMENTS...: rooms.py must not succeed
  local message=$1
  shift
  if python3 "$root/tools/rooms.py" "$@" 2>/dev/null; then
    echo "$message"
    exit 1
  fi
}
{ grep -v '^lumigrid_row(plan ' "$table"; echo 'lumigrid_row(plan USES base)'; } >"$tree/other.cmake"
python3 "$root/tools/rooms.py" --table "$tree/other.cmake" --write "$tree/other.svg"
python3 "$root/tools/rooms.py" --table "$tree/other.cmake" --check "$tree/other.svg"
fails "another table's picture passed" --check "$tree/other.svg"
{ grep -v '^lumigrid_row(plan ' "$table"; echo 'lumigrid_row(plan USES base gone)'; } >"$tree/gone.cmake"
fails "a row that uses a room which is not there passed" --table "$tree/gone.cmake" --write "$tree/gone.svg"
