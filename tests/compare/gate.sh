#!/usr/bin/env bash
# gate.sh BIN BASELINE SHAPE|MESH... [-- REPORT]: builds scenes of generated shapes, or of meshes in the folder that
# LUMIGRID_MESHES names, plays every method in virtual time, and fails with a table where a figure is worse than in
# BASELINE (docs/formats/comparison.md, "The gate"). Without the folder it exits with 77: skipped. Where a change is
# meant to move a figure: run it with a REPORT folder, copy its summary.csv over the baseline, and say why in the
# commit.
set -euo pipefail
bin=$1 baseline=$2
shift 2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
report=$work/report scenes=()
while [ $# -gt 0 ] && [ "$1" != -- ]; do
  name=${1%%.*}
  case $1 in
    *.*)
      mesh=${LUMIGRID_MESHES:-}/$1
      [ -f "$mesh" ] || { echo "gate.sh: $1 is skipped: LUMIGRID_MESHES names no folder that has it"; exit 77; } ;;
    facade)
      mesh=$work/$1.obj
      "$bin/lumigrid" sample --shape "$1" --triangles 5000 -o "$mesh" >/dev/null ;;
    *)
      mesh=$work/$1.ply
      "$bin/lumigrid" sample --shape "$1" --triangles 100000 -o "$mesh" >/dev/null ;;
  esac
  up=$([ "$name" = facade ] && echo y || echo auto)
  "$bin/lumigrid" build "$mesh" -o "$work/$name.scene" --grid 5 --tiles 1 --methods patch,images,qsplat --up "$up" \
    --quiet >/dev/null
  scenes+=("$work/$name.scene")
  shift
done
[ $# -lt 2 ] || report=$2
"$bin/lumigrid-compare" "${scenes[@]}" --paths orbit-fast,teleports-fast --links 1Mbit/60ms/20ms/1% --seconds 4 \
  --size 320 240 --instants 8 --no-pictures --report "$report" --baseline "$baseline"
