#!/usr/bin/env bash
# stated.sh BIN MESH: builds a mesh of the folder that LUMIGRID_MESHES names as docs/results.md does, plays its orbit,
# and fails where the document states another figure, better or worse (tools/results.py --against). Without the folder
# it exits with 77: skipped.
set -euo pipefail
bin=$1 mesh=${LUMIGRID_MESHES:-}/$2
[ -f "$mesh" ] || { echo "stated.sh: skipped: LUMIGRID_MESHES names no folder that has $2"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
scene=$work/${2%.*}.scene
"$bin/lumigrid" build "$mesh" -o "$scene" --grid 8 --quiet
"$bin/lumigrid-compare" "$scene" --methods lumigraph,static --paths orbit \
  --links 384kbit/100ms,20Mbit/40ms --seconds 8 --instants 8 --no-pictures --report "$work/report"
"$(dirname "$0")/../../tools/results.py" --against "$work/report/summary.csv"
