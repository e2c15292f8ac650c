#pragma once
// STL, ASCII and binary.
#include "lod/build/soup.h"

namespace lod::build {

/// Bytes of a whole file -> its vertices and triangles. Errors name the place in the file, not the file.
base::Result<Soup> readStl(base::ByteView bytes);

}  // namespace lod::build
