#!/usr/bin/env bash
# tools/fuzz.sh [--keep] [SECONDS [NAME...]]: builds the fuzz targets with libFuzzer and the sanitizers, runs each of
# them, or those named, for so many seconds (60) on one core, and says how many runs a second it made. Inputs that reach
# new code are gathered in build/fuzz/found/NAME; one that fails is left in build/fuzz/failed and ends the script.
# --keep takes a choice of those that reach code which smaller ones do not into tests/fuzz/corpus/NAME, for ctest.
set -euo pipefail
cd "$(dirname "$0")/.."
export CCACHE_DISABLE=${CCACHE_DISABLE:-1}
keep=no
if [ "${1:-}" = --keep ]; then
  keep=yes
  shift
fi
seconds=${1:-60}
[ $# -eq 0 ] || shift
# The corpus of a target: all of them together stay under 300 KB.
max_files=40 max_bytes=8000

tools/install_packages.sh build fuzz
mkdir -p build
cmake --preset fuzz -DLUMIGRID_QUICK=ON >build/configure.log || { tail -n 20 build/configure.log >&2; exit 1; }
names=("$@")
[ ${#names[@]} -gt 0 ] || names=($(sed -n 's/^lumigrid_fuzz(\([a-z0-9_]*\) .*/\1/p' tests/fuzz/CMakeLists.txt))
cmake --build build/fuzz --target "${names[@]/#/fuzz_}"
mkdir -p build/fuzz/failed

# reduce NAME PROGRAM: the corpus anew from itself and from what was found. Inputs that once failed, failed-*, stay.
reduce() {
  local corpus=tests/fuzz/corpus/$1 merged bytes=0 files=0 size
  merged=$(mktemp -d)
  "$2" -merge=1 "$merged" "$corpus" "build/fuzz/found/$1" >"build/fuzz/$1.log" 2>&1
  find "$corpus" -type f ! -name 'failed-*' -delete
  # Each of the merged reaches code that no smaller one does. Their names are hashes, so that this order prefers none.
  while read -r size file; do
    [ $files -lt $max_files ] && [ $((bytes + size)) -le $max_bytes ] || break
    files=$((files + 1)) bytes=$((bytes + size))
    cp "$merged/$file" "$corpus/"
  done < <(find "$merged" -type f -size -1024c -printf '%s %f\n' | sort -k2)
  rm -rf "$merged"
}

for name in "${names[@]}"; do
  program=build/fuzz/tests/fuzz_$name
  found=build/fuzz/found/$name
  mkdir -p "$found" "tests/fuzz/corpus/$name"
  "$program" --write-seeds "$found"
  log=build/fuzz/$name.log
  if ! "$program" -max_total_time="$seconds" -timeout=20 -rss_limit_mb=2048 -entropic=0 -print_final_stats=1 \
    -artifact_prefix="build/fuzz/failed/$name-" "$found" "tests/fuzz/corpus/$name" >"$log" 2>&1; then
    tail -n 40 "$log"
    echo "$name fails; see $log and build/fuzz/failed" >&2
    exit 1
  fi
  awk -v name="$name" '/stat::number_of_executed_units/ { runs = $2 } /stat::average_exec_per_sec/ { rate = $2 }
    END { printf "%-18s %9d runs, %6d a second\n", name, runs, rate }' "$log"
  [ $keep = no ] || reduce "$name" "$program"
done
