#!/usr/bin/env bash
# Fails on an #include that points up or sideways (DESIGN section 2). One line per folder: what it must not include.
set -u
root=$1
bad=0
forbid() {  # forbid FOLDER REGEX: no file under FOLDER includes a path that matches
  local found
  found=$(grep -rnE "#include \"($2)" "$root/$1" --include='*.h' --include='*.cpp' 2>/dev/null)
  if [ -n "$found" ]; then
    echo "wall: $1 must not include $2:"
    echo "$found"
    bad=1
  fi
}
forbid base '(lod|repository|protocol|plan|server|client|compare|tests)/'
forbid lod '(repository|protocol|plan|server|client|compare|tests)/'
forbid lod/patch '(lod/build|lod/draw|base/gl|base/egl|base/json|base/png)/'
forbid repository '(lod|protocol|plan|server|client|compare|tests)/'
forbid protocol '(lod|plan|server|client|compare|tests)/|repository/(store|jpeg|cache)'
forbid plan '(server|client|compare|tests)/|repository/(store|jpeg|cache)'
forbid server '(compare|tests)/|client/([a-z_]*[.]h|native/|web/)'
for room in cmd net render session; do forbid server/$room 'client/'; done
forbid server/session 'server/(net|render|bake|cmd)/'
forbid server/net 'lod/build/'
forbid client '(server|compare|tests|lod/build)/|repository/store'
forbid client/render 'client/(native|session|viewer)'
forbid compare 'tests/'
# Outside libraries have one home.
home() {  # home REGEX FOLDER...: only these folders include it
  local pattern=$1 found
  shift
  found=$(grep -rnE "#include <($pattern)" "$root"/{base,lod,repository,protocol,plan,server,client,compare} --include='*.h' --include='*.cpp' 2>/dev/null)
  for folder in "$@"; do found=$(printf '%s' "$found" | grep -v "^$root/$folder" || true); done
  if [ -n "$found" ]; then
    echo "wall: <$pattern> belongs to: $*"
    echo "$found"
    bad=1
  fi
}
home 'OpenMesh/|metis' lod/build
home 'boost/' server/net client/native
home 'lmdb' repository
home 'curl/' repository client/native
home 'EGL/' base/egl
home 'turbojpeg|jpeglib' repository lod/build
home 'GLES3/' base/gl base/egl client/native client/web
home 'meshoptimizer'  # a peer in benchmarks only
home 'GLFW|imgui' client/native
home 'opencv' server/image
exit $bad
