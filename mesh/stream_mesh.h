#pragma once
// Reads a mesh file of any format from front to back into a sink: PLY (ASCII and both binary orders), OBJ, STL (ASCII
// and binary), OFF, GLB. Memory does not grow with the file, apart from OBJ's normals and texture coordinates.
#include <functional>
#include <string>
#include <vector>

#include "mesh/mesh_sink.h"

namespace mesh {

struct StreamOptions {
  bool accepts_points = false;           ///< a PLY without faces is no error
  std::function<bool(double)> progress;  ///< share of the file read; false cancels
};

struct StreamedFile {
  std::uint64_t bytes = 0;
  std::uint64_t vertices = 0;
  std::uint64_t triangles = 0;
  std::uint64_t short_faces = 0;  ///< faces with fewer than three corners: left out
  bool has_normals = false;
  bool has_colors = false;
  std::vector<std::string> warnings;  ///< one line each, without the file's name
};

/// The format is told by the content, and by the file's name only where the content does not tell. Errors name the file
/// and the place in it ("scan.ply: face 17: index 99 is out of range (5 vertices)"), or are the sink's.
base::Result<StreamedFile> streamMesh(const std::string& path, MeshSink& sink, const StreamOptions& options);

}  // namespace mesh
