#pragma once
// Wavefront OBJ: v (with optional colour), vn, f.
#include "lod/build/soup.h"

namespace lod::build {

/// Bytes of a whole file -> its vertices and triangles. Errors name the place in the file, not the file.
base::Result<Soup> readObj(base::ByteView bytes);

}  // namespace lod::build
