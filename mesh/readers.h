#pragma once
// The readers of the formats. Each reads the bytes of a whole file into `out`, block by block. Errors name the place in
// the file, not the file.

#include "mesh/mesh_stream.h"

namespace mesh {

/// Khronos' glTF 2.0: GLB, its binary form, or JSON (.gltf). Buffers and pictures may lie in other files.
base::Result<void> readGltf(base::ByteView bytes, MeshStream& out);

/// LAS 1.0 to 1.4, the points of airborne and terrestrial laser scanners (ASPRS). Points that are withheld or noise are
/// left out; LAZ is an error.
base::Result<void> readLas(base::ByteView bytes, MeshStream& out);

/// Wavefront OBJ: vertices (with optional colours), normals, texture coordinates, faces and diffuse textures.
base::Result<void> readObj(base::ByteView bytes, MeshStream& out);

/// Geomview's ASCII formats OFF, COFF, NOFF and CNOFF, with or without the prefix ST.
base::Result<void> readOff(base::ByteView bytes, MeshStream& out);

/// PLY, ASCII and in both binary orders (Turk 1994, "The PLY Polygon File Format").
base::Result<void> readPly(base::ByteView bytes, MeshStream& out);

/// STL, ASCII and binary.
base::Result<void> readStl(base::ByteView bytes, MeshStream& out);

/// Whether the file's length is that of a binary STL with as many triangles as it says, at least one.
bool isBinaryStlBySize(base::ByteView bytes);

}  // namespace mesh
