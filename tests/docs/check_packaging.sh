#!/usr/bin/env bash
# tests/docs/check_packaging.sh ROOT PROGRAM: systemd understands each line of packaging/lumigrid.service and rates its
# exposure as docs/hosting-server.md says. PROGRAM: lumigrid, in place of the installed one. 77: systemd is not here.
set -u
root=$1
program=$2
command -v systemd-analyze >/dev/null || { echo "skipped: no systemd-analyze (Debian: systemd)"; exit 77; }
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
unit=$folder/lumigrid.service
sed "s|/usr/local/bin/lumigrid|$program|" "$root/packaging/lumigrid.service" >"$unit"
# Complaints about other units of this machine are none of ours.
complaints=$(systemd-analyze verify "$unit" 2>&1 | grep lumigrid)
[ -z "$complaints" ] || { echo "$complaints"; exit 1; }
rated=$(systemd-analyze security --offline=true "$unit" 2>/dev/null |
  sed -n 's/.*: \([0-9.]*\) [A-Z].*/\1/p' | tail -n 1)
told=$(sed -n 's/^exposure \([0-9.]*\) of 10.*/\1/p' "$root/docs/hosting-server.md")
[ -n "$told" ] && [ "$rated" = "$told" ] && exit 0
echo "the exposure is $rated, docs/hosting-server.md says '$told'"
exit 1
