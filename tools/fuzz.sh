#!/usr/bin/env bash
# tools/fuzz.sh [--keep] [SECONDS | --runs N] [NAME...]: builds the fuzz targets with libFuzzer and the sanitizers, runs
# each of them, or those named, for so many seconds (60) or so many inputs on one core, and says how many runs a second
# it made. Inputs that reach new code are gathered in build/fuzz/found/NAME; one that fails is left in build/fuzz/failed
# and ends the script. --keep takes a choice of those that reach code which smaller ones do not into
# tests/fuzz/corpus/NAME, for ctest.
set -euo pipefail
cd "$(dirname "$0")/.."
export CCACHE_DISABLE=${CCACHE_DISABLE:-1}

fail() {
  echo "tools/fuzz.sh: $1; usage: tools/fuzz.sh [--keep] [SECONDS | --runs N] [NAME...]" >&2
  exit 2
}

# libFuzzer takes 0 seconds for no limit at all, 0 runs for the corpus alone, and keeps both numbers in 32 bits.
is_count() { [[ $1 =~ ^[1-9][0-9]{0,8}$ ]]; }

keep=no
limit=
while [[ ${1:-} == -* ]]; do
  case $1 in
    --keep) keep=yes ;;
    --runs)
      is_count "${2:-}" || fail "--runs needs a number from 1 to 999999999, not '${2:-}'"
      limit=-runs=$2
      shift
      ;;
    *) fail "there is no option $1" ;;
  esac
  shift
done
if [[ ${1:-} =~ ^[0-9] ]]; then
  [ -z "$limit" ] || fail "either SECONDS or --runs N, not both"
  is_count "$1" || fail "'$1' is no number of seconds from 1 to 999999999"
  limit=-max_total_time=$1
  shift
fi
all=($(sed -n 's/^lumigrid_fuzz(\([a-z0-9_]*\) .*/\1/p' tests/fuzz/CMakeLists.txt))
names=("$@")
[ ${#names[@]} -gt 0 ] || names=("${all[@]}")
for name in "${names[@]}"; do
  [[ " ${all[*]} " == *" $name "* ]] || fail "there is no fuzz target '$name' in tests/fuzz/CMakeLists.txt"
done
# The corpus of a target: all of them together stay under 300 KB.
max_files=40 max_bytes=8000

tools/install_packages.sh build fuzz
mkdir -p build
cmake --preset fuzz -DLUMIGRID_QUICK=ON >build/configure.log || { tail -n 20 build/configure.log >&2; exit 1; }
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
  # Sessions make so many calls of an input and no more, so that they read no more of it either.
  [[ $name == *_session ]] && longest=1024 || longest=0
  if ! "$program" "${limit:--max_total_time=60}" -max_len=$longest -timeout=20 -rss_limit_mb=2048 -entropic=0 \
    -print_final_stats=1 -artifact_prefix="build/fuzz/failed/$name-" "$found" "tests/fuzz/corpus/$name" \
    >"$log" 2>&1; then
    tail -n 40 "$log"
    echo "$name fails; see $log and build/fuzz/failed" >&2
    exit 1
  fi
  awk -v name="$name" '/stat::number_of_executed_units/ { runs = $2 } /stat::average_exec_per_sec/ { rate = $2 }
    END { printf "%-18s %9d runs, %6d a second\n", name, runs, rate }' "$log"
  [ $keep = no ] || reduce "$name" "$program"
done
