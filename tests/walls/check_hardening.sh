#!/usr/bin/env bash
# check_hardening.sh FORTIFIED PROGRAM...: reads in each program that the flags of cmake/LumigridHardening.cmake took
# effect. FORTIFIED: yes where the library's calls are checked, which sanitized and unoptimised builds leave out.
set -u
fortified=$1
shift
failed=0

# expect PROGRAM TEXT PATTERN FAULT
expect() {
  grep -qE "$3" <<<"$2" && return
  echo "$1 $4"
  failed=1
}

for program in "$@"; do
  header=$(readelf -hW "$program") segments=$(readelf -lW "$program")
  dynamic=$(readelf -dW "$program") symbols=$(readelf --dyn-syms -W "$program")
  expect "$program" "$header" 'Type: +DYN' 'lies at a fixed address (no -pie)'
  expect "$program" "$segments" 'GNU_RELRO' 'has a table of functions that stays writable (no -z relro)'
  expect "$program" "$dynamic" 'BIND_NOW|FLAGS_1.*NOW' 'binds functions late (no -z now)'
  expect "$program" "$segments" 'GNU_STACK .* RW +0x' 'has a stack that can be executed'
  expect "$program" "$symbols" '__stack_chk_fail' 'has no stack protector'
  expect "$program" "$symbols" '__glibcxx_assert_fail' 'has containers without checks (_GLIBCXX_ASSERTIONS)'
  [ "$fortified" != yes ] || expect "$program" "$symbols" '__[a-z]+_chk(@|$)' 'has no checked calls (_FORTIFY_SOURCE)'
  # A segment that is writable and executable.
  if grep -qE 'LOAD .* RWE ' <<<"$segments"; then
    echo "$program has memory that is writable and executable"
    failed=1
  fi
done
exit $failed
