#pragma once
// GLB: the binary form of glTF 2.0 (Khronos specification, section numbers below refer to it).
#include "lod/build/soup.h"

namespace lod::build {

/// Bytes of a whole file -> the stream, block by block. Errors name the place in the file, not the file.
base::Result<void> readGlb(base::ByteView bytes, MeshStream& out);

}  // namespace lod::build
