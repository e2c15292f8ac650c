#pragma once
// Mesh files in: PLY (ASCII, both binary orders), OBJ, STL (ASCII, binary), OFF, GLB. One or several files make one
// scene.
#include <string>
#include <vector>

#include "base/error.h"
#include "mesh/mesh.h"

namespace mesh {

struct ImportOptions {
  bool weld = true;  ///< merge vertices at the same position (and the same colour where files carry colours at seams:
                     ///< position decides, colours are averaged)
  double weld_distance = 0.0;  ///< scene units; 0: exactly equal positions only
};

struct SourceFile {
  std::string path;
  std::uint64_t bytes = 0;
  std::uint64_t triangles = 0;  ///< as the file says, before repairs
};

struct Imported {
  Mesh mesh;  ///< clean: no NaN, degenerate, duplicate or unreferenced element; every vertex manifold (complex ones
              ///< split)
  RepairCounts repairs;
  std::vector<SourceFile> sources;
  bool has_normals = false;           ///< true when files gave normals (else they were computed)
  std::vector<std::string> warnings;  ///< one line each, for the user
};

/// Reads, merges and cleans. Broken input that repair can't mend is one error line that names the file and the place
/// ("scan.ply: face 17: index 99 is out of range (5 vertices)").
base::Result<Imported> importMeshes(const std::vector<std::string>& paths, const ImportOptions& options);

}  // namespace mesh
