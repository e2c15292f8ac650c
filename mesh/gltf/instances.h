#pragma once
// How much of a glTF document's geometry its nodes show, and how often. Nodes, primitives, accessors and tiles may all
// name the same bytes again, so that a few megabytes of JSON could ask for more triangles than a disk holds.
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "mesh/gltf/document.h"

namespace mesh::gltf {

/// Counts may be claims of a hostile document, which overflow no double.
struct Amount {
  double triangles = 0.0;
  double vertices = 0.0;
};

/// The document's claims, before anything is read.
struct MeshAmounts {
  std::vector<Amount> meshes;  ///< each mesh's, shown once
  Amount distinct;             ///< of all meshes; bytes that several primitives name count once
  double corners = 0.0;        ///< of all meshes
};
inline constexpr std::uint64_t kPoints = 0;  ///< the mode of a primitive of points (section 3.7.2.1)
/// The triangles of so many corners in a primitive's mode; none but for 4..6.
double trianglesOf(std::uint64_t mode, double corners);
/// Measures primitives of triangles, or those of points.
MeshAmounts measureMeshes(const Document& document, bool points);

/// The nodes that the scene shows, in the order in which a depth-first walk meets them; an error where one has two
/// parents or is its own child. Empty without any nodes: the meshes stand as they are.
struct ShownNode {
  std::uint64_t index = 0;
  std::uint64_t parent = kMissing;  ///< its place in this list; kMissing: the scene
};
base::Result<std::vector<ShownNode>> shownNodes(const Document& document);

/// Geometry that is shown up to so many times is what its author meant: a forest of one tree. So is any scene below
/// the numbers of triangles and vertices, which takes minutes and a few gigabytes of disk.
inline constexpr double kMaxTimesShown = 64.0;
inline constexpr double kMaxShownFreely = 50e6;

/// An error where `shown` is beyond both limits. `held`: what the files have data for.
base::Result<void> checkTimesShown(const Amount& shown, const Amount& held);

}  // namespace mesh::gltf
