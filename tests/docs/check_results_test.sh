#!/usr/bin/env bash
# check_results_test.sh ROOT: tools/results.py refuses a document with another figure, runs that differ from those that
# are stated, and files that hold no runs, each with one line; runs that are as stated pass.
set -euo pipefail
tool=$1/tools/results.py work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
refuses() { # WORDS COMMAND...
  local words=$1 said
  shift
  if said=$("$@" 2>&1); then echo "passed: $*"; exit 1; fi
  case $said in *"$words"*) ;; *) echo "said '$said', not '$words': $*"; exit 1 ;; esac
}
sed 's/\*\*\([0-9]*\)\.[0-9]\*\*/**\1.x**/' "$1/docs/results.md" >"$work/other.md"
refuses 'are not those of docs/results/matrix.csv' "$tool" --check "$work/other.md"
grep -v 'end: orbit ' "$1/docs/results.md" >"$work/cut.md"
refuses "needs '<!-- table: orbit -->'" "$tool" --check "$work/cut.md"
matrix=$1/docs/results/matrix.csv
"$tool" --against "$matrix" >"$work/same"
awk -F, -v OFS=, 'NR == 2 { $5 += 1.5 } { print }' "$matrix" >"$work/better.csv"
refuses 'measure again' "$tool" --against "$work/better.csv"
"$tool" --against "$work/better.csv" --within 2 >"$work/wide"
sed 's/^[a-z_]*,/other,/' "$matrix" | sed '1s/^other/scene/' >"$work/others.csv"
refuses 'none of these runs' "$tool" --against "$work/others.csv"
printf 'a,b\n1,2\n' >"$work/no.csv"
refuses 'needs the columns' "$tool" --against "$work/no.csv"
sed '2s/[0-9.]*,[0-9]*$/much,1/' "$matrix" >"$work/words.csv"
refuses 'line 2: mean_psnr_db and bytes are no numbers' "$tool" --against "$work/words.csv"
refuses "$work/missing.csv" "$tool" --against "$work/missing.csv"
