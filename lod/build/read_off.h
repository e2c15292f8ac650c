#pragma once
// OFF, COFF, NOFF, CNOFF, with or without ST (Geomview's format, ASCII).
#include "lod/build/soup.h"

namespace lod::build {

/// Bytes of a whole file -> its vertices and triangles. Errors name the place in the file, not the file.
base::Result<Soup> readOff(base::ByteView bytes);

}  // namespace lod::build
