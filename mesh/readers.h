#pragma once
// The readers of the formats. Each reads the bytes of a whole file into `out`, block by block. Errors name the place in
// the file, not the file.

#include <nlohmann/json_fwd.hpp>

#include "mesh/mesh_stream.h"

namespace mesh {

/// GLB, the binary form of Khronos' glTF 2.0. Buffers and pictures may lie in other files.
base::Result<void> readGlb(base::ByteView bytes, MeshStream& out);

/// JSON: glTF 2.0, or a tileset of 3D Tiles.
base::Result<void> readJson(base::ByteView bytes, MeshStream& out);
/// Drops what was read of a glTF file or a tileset without triangles, whose points are to be read then; kUnsupported
/// where these are not accepted.
base::Result<void> beginPoints(MeshStream& out);

/// The finest tiles of a tileset of 3D Tiles 1.0 or 1.1, all of which lie in local files.
base::Result<void> readTileset(const nlohmann::json& tileset, MeshStream& out);
/// One tile of 3D Tiles, a batched model (b3dm) or points (pnts).
base::Result<void> readTile(base::ByteView bytes, MeshStream& out);

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

/// Text with a point on each line, as XYZ, PTS, CSV and other names have it: x y z, then an intensity, a colour (0 to
/// 255, or decimals from 0 to 1) or a normal. The number of columns and their first values tell which, or a first line
/// of names. Blanks, tabs, commas or semicolons separate columns; lines that begin with # or // are comments.
base::Result<void> readXyz(base::ByteView bytes, MeshStream& out);

/// PTX, the text of terrestrial scanners (Leica): scans one behind the other, each with a matrix that takes its points
/// to the world's coordinates. Where nothing returned there is no point.
base::Result<void> readPtx(base::ByteView bytes, MeshStream& out);

/// Whether the file's length is that of a binary STL with as many triangles as it says, at least one.
bool isBinaryStlBySize(base::ByteView bytes);

}  // namespace mesh
