#!/usr/bin/env bash
# Installs the Debian packages of tools/packages.txt that are missing; says clearly what to do where it cannot.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
missing=()
while read -r package; do
  case "$package" in ''|'#'*) continue ;; esac
  # Node from elsewhere brings its own npm, and Debian's would not go with it.
  case "$package" in nodejs|npm) command -v "${package%js}" >/dev/null && continue ;; esac
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q '^install ok installed$' || missing+=("$package")
done <"$here/packages.txt"
[ ${#missing[@]} -eq 0 ] && exit 0

echo "installing: ${missing[*]}"
if ! command -v apt-get >/dev/null; then
  echo "Lumigrid is set up with Debian's packages, but there is no apt-get here. Please install these by other means: ${missing[*]}" >&2
  exit 1
fi
run=()
if [ "$(id -u)" -ne 0 ]; then
  if ! command -v sudo >/dev/null; then
    echo "Not root, and no sudo here. Please run as root: apt-get install ${missing[*]}" >&2
    exit 1
  fi
  run=(sudo)
fi
export DEBIAN_FRONTEND=noninteractive
install=(env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "${missing[@]}")
"${run[@]}" apt-get update -q || echo "apt-get update failed; trying with the lists that are here" >&2
"${run[@]}" "${install[@]}" || {
  echo "Could not install: ${missing[*]}. Check the network and the package sources, then run this again." >&2
  exit 1
}
