#pragma once
// Wavefront OBJ: v (with optional colour), vn, f.
#include "lod/build/soup.h"

namespace lod::build {

/// Bytes of a whole file -> the stream, block by block. Errors name the place in the file, not the file.
base::Result<void> readObj(base::ByteView bytes, MeshStream& out);

}  // namespace lod::build
