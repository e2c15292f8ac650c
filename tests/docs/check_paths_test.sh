#!/usr/bin/env bash
# check_paths.py passes where all named paths exist and fails for a planted path and a planted link.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
mkdir -p "$tree/docs" "$tree/base"
: >"$tree/base/file.cpp"
echo 'Read `base/file.*`, `base/`, `lumigrid build x/y -o SCENE/z`, `base/NAME.cpp` and [this](docs/page.md).' \
  >"$tree/README.md"
echo 'Back to [the start](../README.md).' >"$tree/docs/page.md"
python3 "$here/check_paths.py" "$tree"
for planted in '`base/gone.cpp`' '`base/gone.*`' '[gone](gone.md)'; do
  echo "See $planted." >"$tree/docs/stale.md"
  if python3 "$here/check_paths.py" "$tree" >/dev/null; then
    echo "not found: $planted"
    exit 1
  fi
done
