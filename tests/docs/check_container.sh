#!/usr/bin/env bash
# tests/docs/check_container.sh ROOT PROGRAM: what packaging/Containerfile copies from the repository is there, and its
# list of packages has one for each library that PROGRAM loads. 77: this is no Debian.
set -u
root=$1
program=$2
file=$root/packaging/Containerfile
command -v dpkg-query >/dev/null || { echo "skipped: no dpkg"; exit 77; }
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
failed=0

copied=$(sed -n '/--from=/d; s/^COPY \(.*\) [^ ]*$/\1/p' "$file")
[ -n "$copied" ] || { echo "$file copies nothing"; exit 1; }
for path in $copied; do
  [ -e "$root/$path" ] || { echo "$file copies $path, which is not there"; failed=1; }
done
grep -qx build "$root/.containerignore" || { echo ".containerignore lets other builds be copied"; failed=1; }

# The command that makes the list, with other paths.
command=$(sed -n '/^RUN ldd/,/[^\\]$/p' "$file" | sed "s|^RUN ||; s|/installed/bin/lumigrid|$program|g")
[ -n "$command" ] || { echo "$file makes no list of packages"; exit 1; }
sh -c "${command//\/installed\//$folder/}" || { echo "the list of packages cannot be made"; exit 1; }
for library in $(ldd "$program" | awk '$3 ~ "^/" {print $3}'); do
  library=$(realpath "$library")
  package=$(dpkg-query -S "$library" 2>/dev/null || dpkg-query -S "${library#/usr}" 2>/dev/null) ||
    { echo "skipped: no package has $library"; exit 77; }
  grep -qx "${package%%:*}" "$folder/packages.txt" || { echo "$library is of ${package%%:*}, not listed"; failed=1; }
done
exit $failed
