#pragma once
// The triangles of a node while the octree is built.
#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "lod/patch/builder/distance_bound.h"

namespace lod::hlod::builder {

/// A place of the surface that no triangle shows any more.
struct MeshPoint {
  glm::vec3 position{0.0F};  ///< lattice steps from the mesh's corner
  glm::vec3 normal{0.0F, 0.0F, 1.0F};
  glm::vec3 color{255.0F};  ///< 0 … 255; white where the source has no colours
};

struct NodeMesh {
  glm::ivec3 corner{0};              ///< the lattice point at which positions start
  std::vector<glm::vec3> positions;  ///< lattice steps from the corner: whole numbers below 2^22, exact in float
  std::vector<glm::vec3> normals;    ///< as many as positions; unit
  std::vector<glm::vec3> colors;     ///< 0 … 255; empty, or as many as positions
  /// As many as positions. 1: a vertex on the source's own border, whose open edges are no cracks.
  std::vector<std::uint8_t> on_rim;
  std::vector<std::uint32_t> indices;  ///< 3 per triangle
  /// The bounds that triangles carry of earlier simplifications, lattice steps; without colours.
  patch::builder::SurfaceError bounds;
  /// ε so far: the largest distance of a source's place from one of the same appearance on a triangle, lattice steps.
  float error = 0.0F;
  /// ε triangle by triangle, where it is known: at most `error`. Empty: nothing is known. Work files leave it out.
  std::vector<float> errors;
  std::vector<MeshPoint> points;
  /// ε so far of the places that points stand for, and the largest of the bounds of the triangles that they replaced.
  float points_error = 0.0F, points_bound = 0.0F;

  std::size_t triangles() const { return indices.size() / 3; }
  float errorOf(std::size_t triangle) const { return errors.empty() ? error : errors[triangle]; }
};

/// An edge of only one triangle: its number times 3, plus the corner at which the edge begins.
using OpenEdge = std::uint32_t;
std::vector<OpenEdge> openEdges(std::span<const std::uint32_t> indices);
struct MeshEdges {
  std::vector<OpenEdge> open;
  /// Those of exactly two triangles, one number of each triangle, in the same way.
  std::vector<std::array<OpenEdge, 2>> shared;
};
MeshEdges edgesOf(std::span<const std::uint32_t> indices);
/// The ends of the edge in the winding of its triangle.
inline glm::uvec2 endsOf(OpenEdge edge, std::span<const std::uint32_t> indices) {
  const std::size_t first = std::size_t{edge} / 3 * 3;
  return {indices[edge], indices[first + (edge - first + 1) % 3]};
}

/// The mesh as bytes of a work file, and back; errors are rounded up (patch::builder::errorCode). Error: kInvalidInput
/// where the bytes are none.
base::Bytes meshBytes(const NodeMesh& mesh);
base::Result<NodeMesh> readMesh(base::ByteView bytes);

/// Leaves out vertices that no triangle uses.
void dropUnusedVertices(NodeMesh& mesh);

}  // namespace lod::hlod::builder
