#!/usr/bin/env bash
# The thin client links none of METIS, OpenMesh, OpenCV, LMDB, Draco, meshoptimizer: neither dynamically nor by symbols.
set -u
needed=$(ldd "$1" | grep -iE 'metis|openmesh|opencv|lmdb|draco|meshoptimizer')
symbols=$(nm -C "$1" 2>/dev/null | grep -E 'METIS_|OpenMesh::|cv::|mdb_env_|::builder::|lod::ingest::' | head -5)
[ -z "$needed$symbols" ] && exit 0
echo "$1 links: $needed $symbols"
exit 1
