#!/usr/bin/env bash
# The check must fail where an arrow is broken, and pass where none is.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
mkdir -p "$tree"/{base/{gl,egl,http,jpeg,tls},mesh/gltf,protocol,plan,compare,tests}
mkdir -p "$tree"/lod/{ingest,draw,texture,patch/builder,qsplat/builder,pmr/builder,hlod/builder}
mkdir -p "$tree"/{repository/{sampling,faces,packs,objects},server/{auth,bake,cli,export,log,metrics}}
mkdir -p "$tree"/server/{net,render,scene,session,trial,views}
mkdir -p "$tree"/client/{app,source,viewer,render,native,web}
echo '#include "base/error.h"' >"$tree/lod/patch/a.h"
"$here/check_includes.sh" "$tree"
mv "$tree/plan" "$tree/gone"
if "$here/check_includes.sh" "$tree" >/dev/null; then
  echo "not found: a wall around a folder that is not there"
  exit 1
fi
mv "$tree/gone" "$tree/plan"
for planted in 'base/a.h:"lod/lattice.h"' \
  'lod/patch/b.h:"server/net/server.h"' \
  'client/c.cpp:"server/session/session.h"' \
  'client/d.cpp:<boost/asio.hpp>' \
  'server/session/e.cpp:"client/session.h"' \
  'server/net/f.cpp:"server/trial/trial.h"' \
  'server/trial/g.cpp:"client/app/app.h"' \
  'lod/pmr/h.cpp:"lod/hlod/format.h"'; do
  file=$tree/${planted%%:*}
  echo "#include ${planted#*:}" >"$file"
  if "$here/check_includes.sh" "$tree" >/dev/null; then
    echo "not found: $planted"
    exit 1
  fi
  rm "$file"
done
