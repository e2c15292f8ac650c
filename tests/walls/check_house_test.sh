#!/usr/bin/env bash
# Each check of check_house.py passes on a small clean tree and fails where a violation is planted.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
mkdir -p "$tree/base" "$tree/docs"

body() { for _ in $(seq "$1"); do echo '  ++x;'; done; }
{
  echo 'namespace base {'
  echo 'struct Table {'
  body 150
  echo '};'
  echo 'int count(int x) {'
  echo '  const char* brace = "{";  // { Whatever follows is text.'
  body 90
  echo '  return x;'
  echo '}'
  echo '}  // namespace base'
} >"$tree/base/clean.cpp"
echo "| $(printf 'x%.0s' $(seq 150)) |" >"$tree/docs/table.md"
printf '# What does it hold?\n\nSome of\nWhat follows.\n' >"$tree/docs/question.md"
python3 "$here/check_house.py" "$tree" || { echo "the clean tree does not pass"; exit 1; }

refuses() {  # refuses CHECK FILE: FILE, just written, is found by CHECK
  if python3 "$here/check_house.py" "$tree" "$1" >/dev/null; then
    echo "not found by '$1': $2"
    exit 1
  fi
  rm -r "${tree:?}/$2"
}
mkdir "$tree/base/build"
: >"$tree/base/build/file.cpp"
refuses folders base/build
mkdir "$tree/base/many"
for i in $(seq 41); do : >"$tree/base/many/file$i.cpp"; done
refuses folders base/many
body 901 >"$tree/base/long.cpp"
refuses files base/long.cpp
for head in 'int f(int x) {' 'Shape::Shape(int x) : x_(x) {' \
  'template <typename T> T Shape::f(struct Edge e) const noexcept {'; do
  { echo "$head"; body 100; echo '}'; } >"$tree/base/long_function.cpp"
  refuses functions base/long_function.cpp
done
what=What  # so that this file passes the check itself
for line in '// Of all points the nearest.' "  int x;  ///< $what is seen." '/// What it does.'; do
  echo "$line" >"$tree/base/comment.h"
  refuses comments base/comment.h
done
echo '# Of all targets the last.' >"$tree/base/CMakeLists.txt"
refuses comments base/CMakeLists.txt
for line in "# $what it holds" "**$what was tried.** Nothing." "- Of two the first."; do
  printf 'A line.\n\n%s\n' "$line" >"$tree/docs/page.md"
  refuses prose docs/page.md
done
printf '%0121d\n' 0 >"$tree/base/wide.h"
refuses lines base/wide.h
printf '%0121d\n' 0 >"$tree/docs/wide.md"
refuses lines docs/wide.md
