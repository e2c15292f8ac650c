#pragma once
// PLY: ASCII and both binary orders (Turk 1994, "The PLY Polygon File Format")
#include "lod/build/soup.h"

namespace lod::build {

/// Bytes of a whole file -> its vertices and triangles. Errors name the place in the file, not the file.
base::Result<Soup> readPly(base::ByteView bytes);

}  // namespace lod::build
