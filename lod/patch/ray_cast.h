#pragma once
// Finds the nearest place where a ray meets the surface of a patch hierarchy, for picking and measuring on the true
// surface whatever is drawn. Groups are walked front to back by their spheres, patches by their boxes. Only blocks that
// the ray may meet before its hit are needed: two or three for a ray at a scan.
//
// Blocks come from wherever the caller keeps them: a PatchFile, a client's cache. Where one is missing the walk goes on
// and names its group, so a caller that fetches does
//
//   for (;;) {
//     cast = castRay(hierarchy, ray, blocks);     // an error: bytes are damaged, or the ray is none
//     if (cast->needed.empty()) break;            // cast->hit is the answer
//     … fetch the blocks (and records) of cast->needed, or of the first few: the nearest come first …
//   }
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <limits>
#include <optional>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch {

class PatchFile;

struct Ray {
  glm::dvec3 origin{0.0};                                         ///< scene-local, anywhere
  glm::dvec3 direction{0.0, 0.0, -1.0};                           ///< any length but zero
  double max_distance = std::numeric_limits<double>::infinity();  ///< scene units, ≥ 0; what lies farther is not met
};

struct RayHit {
  glm::dvec3 point{0.0};   ///< scene-local
  glm::dvec3 normal{0.0};  ///< unit, of the triangle: towards the side from which its corners run counter-clockwise
  double distance = 0.0;   ///< from the origin, scene units
  bool front = true;       ///< the ray met the side that the normal points to
  /// Scene units: a lattice step (source points lie within one of their lattice points) and the stated error of the
  /// patch that was hit, which is 0 for leaves.
  double accuracy = 0.0;
  std::uint32_t group = 0;  ///< in whose block the patch lies: its consumer
  std::uint32_t patch = 0;
  std::uint32_t triangle = 0;  ///< as decoded: corners indices[3 · triangle …]
  glm::dvec3 weights{0.0};     ///< weights of these corners, to interpolate colours and normals
};

struct RayCast {
  std::optional<RayHit> hit;  ///< the nearest among what is here
  /// Groups that may hold something nearer but whose block, or on a growing hierarchy whose record, is not here:
  /// nearest first, each once. Empty: the answer is final.
  std::vector<std::uint32_t> needed;
};

/// Bytes of a group's block (PatchFile::block), valid until the next call; nullopt: not here. An error ends the walk.
using BlockSource = std::function<base::Result<std::optional<base::ByteView>>(std::uint32_t group)>;

/// The blocks of a file, which must live as long.
BlockSource blocksOf(const PatchFile& file);

/// The hierarchy at full resolution (`tolerance` 0), or its coarsest cut whose patches all state an error of at most
/// `tolerance` (scene units; selectUniformCut). Both sides of triangles are hit. At equal distances the triangle with
/// the smallest patch and triangle number is returned, so the answer does not depend on the order of blocks.
/// Errors: a ray that is not finite or has no direction, a tolerance below 0, what `blocks` returns, a block that is
/// damaged or not as long as its record says (named by group and patch).
base::Result<RayCast> castRay(const Hierarchy& hierarchy, const Ray& ray, const BlockSource& blocks,
                              float tolerance = 0.0F);

}  // namespace lod::patch
