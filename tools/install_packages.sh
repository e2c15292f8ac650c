#!/usr/bin/env bash
# tools/install_packages.sh PURPOSE...: installs the Debian packages of these sections of tools/packages.txt (run,
# build, web, compare, pmr, test, fuzz) that are missing, and says what to do where it cannot. --list prints the names
# and installs nothing.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
list=no
if [ "${1:-}" = --list ]; then
  list=yes
  shift
fi
if [ $# -eq 0 ]; then
  echo "usage: tools/install_packages.sh [--list] PURPOSE... (run, build, web, compare, pmr, test, fuzz)" >&2
  exit 2
fi

wanted=()
for purpose in "$@"; do
  grep -q "^\[$purpose\]" "$here/packages.txt" || { echo "tools/packages.txt has no section [$purpose]" >&2; exit 2; }
  section=
  while read -r package _; do
    case "$package" in
      '' | '#'*) ;;
      '['*) section=$package ;;
      *) [ "$section" != "[$purpose]" ] || wanted+=("$package") ;;
    esac
  done <"$here/packages.txt"
done
if [ $list = yes ]; then
  printf '%s\n' "${wanted[@]}" | sort -u
  exit 0
fi

missing=()
for package in "${wanted[@]}"; do
  # Node from elsewhere brings its own npm, and Debian's cannot be installed beside it.
  case "$package" in nodejs | npm) command -v "${package%js}" >/dev/null && continue ;; esac
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q '^install ok installed$' || missing+=("$package")
done
[ ${#missing[@]} -eq 0 ] && exit 0

echo "installing: ${missing[*]}"
if ! command -v apt-get >/dev/null; then
  echo "Lumigrid is set up with Debian's packages, but there is no apt-get here." >&2
  echo "Please install these by other means: ${missing[*]}" >&2
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
install=(env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "${missing[@]}")
"${run[@]}" apt-get update -q || echo "apt-get update failed; trying with the lists that are here" >&2
"${run[@]}" "${install[@]}" || {
  echo "Could not install: ${missing[*]}. Check the network and the package sources, then run this again." >&2
  exit 1
}
