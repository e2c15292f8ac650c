#!/usr/bin/env bash
# check_hardening_test.sh COMPILER: a program that was built without any of the flags fails each check by its name.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
printf 'int main() { return 0; }\n' >"$folder/plain.cpp"
"$1" -o "$folder/plain" "$folder/plain.cpp" -no-pie -fno-pie -fno-stack-protector -U_FORTIFY_SOURCE -Wl,-z,norelro \
  -Wl,-z,lazy -Wl,-z,execstack 2>"$folder/log" || { cat "$folder/log"; exit 1; }
if said=$("$here/check_hardening.sh" yes "$folder/plain"); then
  echo "the check accepts a program without any protection"
  exit 1
fi
for fault in 'fixed address' 'stays writable' 'binds functions late' 'can be executed' 'no stack protector' \
  'without checks' 'no checked calls'; do
  grep -q "$fault" <<<"$said" || { echo "the check does not find: $fault"; echo "$said"; exit 1; }
done
