#pragma once
// Reads Wavefront OBJ: vertices (with optional colours), normals, texture coordinates, faces and diffuse textures.
#include "mesh/mesh_stream.h"

namespace mesh {

/// Reads the bytes of a whole file into `out`, block by block. Errors name the place in the file, not the file.
base::Result<void> readObj(base::ByteView bytes, MeshStream& out);

}  // namespace mesh
