#!/usr/bin/env bash
# Fails on an #include that points up or sideways. One line per folder: what it must not include.
set -u
root=$1
bad=0
there() {  # there FOLDER: a wall around a room that is not there guards nothing
  [ -d "$root/$1" ] || { echo "wall: there is no folder $1"; bad=1; }
}
forbid() {  # forbid FOLDER REGEX: no file under FOLDER includes a path that matches
  local found
  there "$1"
  found=$(grep -rnE "#include \"($2)" "$root/$1" --include='*.h' --include='*.cpp' 2>/dev/null)
  if [ -n "$found" ]; then
    echo "wall: $1 must not include $2:"
    echo "$found"
    bad=1
  fi
}
forbid_but() {  # forbid_but FOLDER ROOM REGEX: as forbid, but not for a room of that name that lies in the folder
  local found
  there "$1"
  found=$(grep -rnE "#include \"($3)" "$root/$1" --include='*.h' --include='*.cpp' --exclude-dir="$2" 2>/dev/null)
  if [ -n "$found" ]; then
    echo "wall: $1 must not include $3:"
    echo "$found"
    bad=1
  fi
}
forbid base '(mesh|lod|repository|protocol|plan|server|client|compare|tests)/'
forbid mesh '(lod|repository|protocol|plan|server|client|compare|tests)/|base/(gl|egl|json|hash)/'
forbid lod '(repository|protocol|plan|server|client|compare|tests)/|base/(egl|json|png)/'
for room in patch qsplat pmr hlod; do
  forbid_but lod/$room builder 'mesh/|lod/ingest/|lod/[a-z]+/builder/|lod/draw/|base/gl/'
done
forbid lod/ingest 'lod/(patch|qsplat|pmr|hlod|draw)/|base/gl/'
forbid lod/patch/builder 'lod/(qsplat|pmr|hlod|draw)/|base/gl/'
forbid lod/qsplat/builder 'lod/(patch|pmr|hlod|draw)/|base/gl/'
forbid lod/pmr/builder 'lod/(patch|qsplat|hlod|draw)/|base/gl/'
forbid lod/hlod 'lod/(qsplat|draw)/|base/gl/'
forbid lod/patch 'lod/(qsplat|pmr|hlod|draw)/'
forbid lod/pmr 'lod/(patch|qsplat|hlod|draw)/'
forbid lod/texture 'mesh/|lod/(ingest|patch|qsplat|pmr|hlod|draw)/|base/gl/'
forbid lod/draw 'mesh/|lod/ingest/|lod/[a-z]+/builder/'
forbid repository '(mesh|lod|protocol|plan|server|client|compare|tests)/'
forbid repository/sampling 'repository/(faces|packs|objects|[a-z_]+[.]h)'
forbid repository/faces 'repository/(sampling|packs|objects|[a-z_]+[.]h)'
forbid repository/objects 'repository/(sampling|faces|packs|store|repository|verify|access)'
forbid protocol '(mesh|lod|plan|server|client|compare|tests)/|repository/(faces|packs|objects|[a-z_]+[.]h)'
forbid plan '(mesh|server|client|compare|tests)/|lod/ingest/|lod/[a-z]+/builder/'
forbid plan 'repository/(faces|packs|objects|(access|access_counter|lmdb_environment|repository|store|verify)[.]h)'
forbid server '(compare|tests)/'
forbid_but server trial 'client/'
forbid server/trial 'client/(app|native|web)/|server/(net|cli)/'
for room in bake export net render scene session views; do forbid server/$room 'server/trial/'; done
for room in bake export render scene session trial views; do forbid server/$room 'server/(log|metrics)/'; done
forbid server/session 'server/(net|render|bake|cli|scene|views)/'
forbid server/views 'server/(net|render|bake|cli|scene|session|export|auth)/|plan/|protocol/'
forbid server/scene 'server/(net|render|bake|cli)/'
for room in log metrics; do
  forbid server/$room '(mesh|lod|repository|protocol|plan|client)/|server/(net|render|bake|cli|session|export|trial)/'
done
forbid server/export 'lod/draw/|base/(gl|egl)/|repository/|protocol/|plan/|server/(net|render|bake|cli|session)/'
for room in bake export net render scene session; do
  forbid server/$room 'mesh/|lod/ingest/|lod/[a-z]+/builder/|server/cli/'
done
forbid client '(mesh|server|compare|tests)/|lod/ingest/|lod/[a-z]+/builder/'
forbid client 'repository/(objects|packs/(pack_store|publish)|store|repository|verify|access)'
forbid client/render 'client/(app|source|viewer|native|web)/'
forbid client/source 'client/(app|viewer|native|web)/'
forbid client/viewer 'client/(app|native|web)/'
forbid client/app 'client/(native|web)/'
forbid compare 'tests/'
# Outside libraries have one home.
home() {  # home REGEX FOLDER...: only these folders include it
  local pattern=$1 found
  shift
  found=$(grep -rnE "#include <($pattern)" "$root"/{base,mesh,lod,repository,protocol,plan,server,client,compare} \
    --include='*.h' --include='*.cpp' 2>/dev/null)
  for folder in "$@"; do there "$folder"; done
  for folder in "$@"; do found=$(printf '%s' "$found" | grep -v "^$root/$folder" || true); done
  if [ -n "$found" ]; then
    echo "wall: <$pattern> belongs to: $*"
    echo "$found"
    bad=1
  fi
}
home 'metis' lod/patch/builder
home 'CGAL/' lod/pmr/builder
home 'OpenMesh/' server/cli
home 'boost/' server/net client/native base/tls
home 'openssl/(ssl|x509)' base/tls
home 'lmdb' repository
home 'curl/' base/http
home 'EGL/' base/egl
home 'turbojpeg|jpeglib' base/jpeg mesh
home 'webp/' repository/faces mesh
home 'zlib' lod/texture
home 'GLES3/' base/gl base/egl client/native client/web
home 'meshoptimizer|draco/' mesh/gltf
home 'GLFW|imgui' client/native
home 'opencv' compare
exit $bad
