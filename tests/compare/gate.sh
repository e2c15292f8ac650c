#!/usr/bin/env bash
# gate.sh BIN BASELINE [REPORT]: builds two generated scenes, plays every method in virtual time, and fails with a table
# where a figure is worse than in BASELINE (docs/formats/comparison.md, "The gate"). Where a change is meant to move a
# figure: run it with a REPORT folder, copy its summary.csv over the baseline, and say why in the commit.
set -euo pipefail
bin=$1 baseline=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
report=${3:-$work/report}
for shape in statue relief; do
  "$bin/lumigrid" sample --shape $shape --triangles 100000 -o "$work/$shape.ply" >/dev/null
  "$bin/lumigrid" build "$work/$shape.ply" -o "$work/$shape.scene" --grid 5 --face 256 --methods patch,images,qsplat \
    --quiet >/dev/null
done
"$bin/lumigrid-compare" "$work/statue.scene" "$work/relief.scene" --paths orbit-fast,teleports-fast \
  --links 1Mbit/60ms/20ms/1% --seconds 4 --size 320 240 --instants 8 --truth-supersampling 2 --no-pictures \
  --report "$report" --baseline "$baseline"
