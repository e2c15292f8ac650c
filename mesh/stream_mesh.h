#pragma once
// A mesh file of any format read from front to back into a sink: PLY (ASCII, both binary orders), OBJ, STL (ASCII,
// binary), OFF, GLB. Memory does not grow with the file, but for OBJ's normals.
#include <functional>
#include <string>
#include <vector>

#include "mesh/mesh_sink.h"

namespace mesh {

struct StreamOptions {
  bool points = false;                   ///< a PLY without faces is welcome
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

/// The content decides about the format; only where it says nothing, the name. Errors name the file and the place in it
/// ("scan.ply: face 17: index 99 is out of range (5 vertices)"), or are the sink's.
base::Result<StreamedFile> streamMesh(const std::string& path, MeshSink& sink, const StreamOptions& options);

}  // namespace mesh
