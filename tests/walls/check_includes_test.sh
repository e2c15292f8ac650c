#!/usr/bin/env bash
# The check must fail where an arrow is broken, and pass where none is.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
mkdir -p "$tree"/{base,lod/patch,repository,protocol,server/session,client/native,compare}
echo '#include "base/error.h"' >"$tree/lod/patch/a.h"
"$here/check_includes.sh" "$tree"
for planted in 'base/a.h:"lod/lattice.h"' 'lod/patch/b.h:"server/net/server.h"' 'client/c.cpp:"server/session/session.h"' 'client/d.cpp:<boost/asio.hpp>' 'server/session/e.cpp:"client/session.h"'; do
  file=$tree/${planted%%:*}
  echo "#include ${planted#*:}" >"$file"
  if "$here/check_includes.sh" "$tree" >/dev/null; then
    echo "not found: $planted"
    exit 1
  fi
  rm "$file"
done
