#pragma once
// Mesh in, patch.lgp out (Okamoto 2011, section 4.1; DESIGN section 4): voxels, METIS bisection, levels regrouped and
// simplified.
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "base/error.h"
#include "lod/build/mesh.h"
#include "lod/patch/hierarchy.h"

namespace lod::build {

struct HierarchyOptions {
  std::uint32_t voxel_triangles = 500;  ///< Nv: a voxel over this is subdivided
  std::uint32_t leaf_triangles = 4000;  ///< Nl: most triangles of a leaf patch
  std::uint32_t node_triangles = 2000;  ///< Nn: most triangles of any other patch
  std::uint32_t group_patches = 4;      ///< about how many patches make a group
  std::uint32_t position_bits =
      0;  ///< 10..21 bits along the longest side; 0: chosen so that the step is at most 1/16 of the mean edge
  unsigned threads = 0;  ///< 0: all cores. The output does not depend on it.
};

struct LevelSummary {
  std::uint64_t triangles = 0;
  std::uint64_t patches = 0;
  float max_error = 0.0F;  ///< scene units
};

struct HierarchySummary {
  std::vector<LevelSummary> levels;  ///< 0 = leaves
  RepairCounts repairs;              ///< made on the lattice (collapsed triangles)
  double seconds = 0.0;
  double cpu_seconds = 0.0;
  std::uint64_t bytes = 0;
};

/// Stage name, 0..1 done. Return false to cancel. Called from worker threads too, but never from two at once.
using Progress = std::function<bool(const std::string& stage, double done)>;

/// Builds and writes `output_path`, which appears whole or not at all. Errors: kInvalidInput (a mesh without triangles,
/// a bad index or position, options out of range), kCancelled (progress said so; nothing is written), and those of
/// writing.
base::Result<HierarchySummary> buildHierarchy(const Mesh& mesh, const HierarchyOptions& options,
                                              const std::string& output_path, const Progress& progress = nullptr);

/// The same hierarchy before it is written: geometry[p] is patch p's. For tests and for small scenes.
struct BuiltHierarchy {
  lod::patch::Hierarchy hierarchy;
  std::vector<lod::patch::PatchGeometry> geometry;
  HierarchySummary summary;
};
base::Result<BuiltHierarchy> buildHierarchyInMemory(const Mesh& mesh, const HierarchyOptions& options,
                                                    const Progress& progress = nullptr);

}  // namespace lod::build
