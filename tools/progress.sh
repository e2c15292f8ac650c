#!/usr/bin/env bash
# tools/progress.sh TITLE LOG COMMAND...: runs a build command (cmake --build ...) with its output in LOG and says every
# five seconds how many steps are done and which files are being made. When the command fails the end of LOG is shown.
set -u
title=$1 log=$2
shift 2
"$@" >"$log" 2>&1 </dev/null &
build=$!
trap 'kill $build 2>/dev/null' INT TERM

# The process's descendants, by Linux's own list; a minimal Debian has no ps.
descendants() {
  local child
  for child in $(cat /proc/"$1"/task/*/children 2>/dev/null); do
    echo "$child"
    descendants "$child"
  done
}
# The files that compilers and linkers among them write: the argument behind -o.
current() {
  local pid
  for pid in $(descendants $build); do
    tr '\0' '\n' 2>/dev/null <"/proc/$pid/cmdline" | grep -aA1 -x -e -o | tail -n 1
  done | grep -aE '[.](o|a|wasm|js)$|^bin/|^tests/' | sed 's|CMakeFiles/[^/]*[.]dir/||
    s|Unity/unity_\(.*\)_cxx[.]cxx|\1|
    s|[.]o$||' | sort -u | head -n 4 | paste -sd ' '
}
say() {
  local steps
  steps=$(grep -aoE '^\[[0-9]+/[0-9]+\]' "$log" | tail -n 1)
  printf '%s %d:%02d %s %s\n' "$title" $((SECONDS / 60)) $((SECONDS % 60)) "${steps:-[starting]}" "$1"
}
while kill -0 $build 2>/dev/null; do
  for _ in 1 2 3 4 5 6 7 8 9 10; do
    sleep 0.5
    kill -0 $build 2>/dev/null || break 2
  done
  say "$(current)"
done
status=0
wait $build || status=$?
if [ $status -eq 0 ]; then
  say done
else
  tail -n 60 "$log" >&2
  echo "$title: failed (status $status); the whole output is in $log" >&2
fi
exit $status
