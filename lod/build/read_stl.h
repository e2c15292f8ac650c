#pragma once
// STL, ASCII and binary.
#include "lod/build/soup.h"

namespace lod::build {

/// Bytes of a whole file -> the stream, block by block. Errors name the place in the file, not the file.
base::Result<void> readStl(base::ByteView bytes, MeshStream& out);

}  // namespace lod::build
