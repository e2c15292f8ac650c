#include "mesh/gltf/instances.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <utility>

#include "mesh/mesh_stream.h"

namespace mesh::gltf {
namespace {

/// The place of an accessor's elements in the file. Those of sparse accessors are each their own.
using Place = std::array<std::uint64_t, 3>;

Place placeOf(const Document& document, std::uint64_t accessor) {
  const json& source = item(document.list("accessors"), accessor);
  const std::uint64_t view = integer(member(source, "bufferView"), kMissing);
  if (view == kMissing || member(source, "sparse").is_object()) return {0, accessor, 0};
  return {1, view, integer(member(source, "byteOffset"), 0)};
}

bool standsOnZeros(const json& accessor) {
  return member(accessor, "sparse").is_object() && member(accessor, "bufferView").is_null();
}

double countOf(const json& accessor) {
  const std::uint64_t count = integer(member(accessor, "count"), 0);
  return static_cast<double>(standsOnZeros(accessor) ? std::min(count, kMaxSparseBase) : count);
}

/// The elements that an accessor has bytes for.
double heldBy(const json& accessor) {
  return countOf(standsOnZeros(accessor) ? member(accessor, "sparse") : accessor);
}

class Measure {
 public:
  Measure(const Document& document, bool points) : document_(document), points_(points) {}

  MeshAmounts measure() {
    const json& meshes = document_.list("meshes");
    found_.meshes.resize(itemsOf(meshes));
    for (std::size_t m = 0; m < itemsOf(meshes); ++m) {
      const json& primitives = member(meshes[m], "primitives");
      for (std::size_t p = 0; p < itemsOf(primitives); ++p) add(primitives[p], found_.meshes[m]);
    }
    return std::move(found_);
  }

 private:
  void add(const json& primitive, Amount& mesh) {
    const std::uint64_t mode = integer(member(primitive, "mode"), 4);
    if (points_ ? mode != kPoints : mode < 4 || mode > 6) return;
    const std::uint64_t position = integer(member(member(primitive, "attributes"), "POSITION"), kMissing);
    const json& indices = member(primitive, "indices");
    const std::uint64_t corner = indices.is_null() ? position : integer(indices, kMissing);
    const json& vertices = item(document_.list("accessors"), position);
    const json& corners = item(document_.list("accessors"), corner);
    mesh.triangles += trianglesOf(mode, countOf(corners));
    mesh.vertices += countOf(points_ ? corners : vertices);
    found_.corners += countOf(corners);

    const json& draco = extension(primitive, "KHR_draco_mesh_compression");
    const Place compressed{2, integer(member(draco, "bufferView"), kMissing), 0};
    if (corner_places_.insert(draco.is_object() ? compressed : placeOf(document_, corner)).second)
      found_.distinct.triangles += trianglesOf(mode, heldBy(corners));
    if (vertex_places_.insert(draco.is_object() ? compressed : placeOf(document_, position)).second)
      found_.distinct.vertices += heldBy(vertices);
  }

  const Document& document_;
  const bool points_;
  MeshAmounts found_;
  std::set<Place> corner_places_, vertex_places_;
};

/// The roots of the default scene, or all nodes that are nobody's child.
std::vector<std::uint64_t> rootNodes(const Document& document) {
  std::vector<std::uint64_t> roots;
  const json& listed = member(item(document.list("scenes"), integer(member(document.root(), "scene"), 0)), "nodes");
  if (listed.is_array()) {
    for (const json& node : listed) roots.push_back(integer(node, kMissing));
    return roots;
  }
  const json& nodes = document.list("nodes");
  std::vector<bool> is_child(itemsOf(nodes), false);
  for (std::size_t n = 0; n < is_child.size(); ++n) {
    const json& children = member(nodes[n], "children");
    for (std::size_t c = 0; c < itemsOf(children); ++c) {
      const std::uint64_t child = integer(children[c], kMissing);
      if (child < is_child.size()) is_child[child] = true;
    }
  }
  for (std::size_t n = 0; n < is_child.size(); ++n)
    if (!is_child[n]) roots.push_back(n);
  return roots;
}

/// A number as people write it: no exponent, no digits after the point.
std::string wholeNumber(double value) {
  return std::to_string(static_cast<std::uint64_t>(std::min(value, 1e18)));
}

}  // namespace

double trianglesOf(std::uint64_t mode, double corners) {
  if (mode < 4) return 0.0;
  return mode == 4 ? std::floor(corners / 3.0) : std::max(0.0, corners - 2.0);
}

MeshAmounts measureMeshes(const Document& document, bool points) {
  return Measure(document, points).measure();
}

base::Result<std::vector<ShownNode>> shownNodes(const Document& document) {
  const json& nodes = document.list("nodes");
  if (itemsOf(nodes) == 0) return std::vector<ShownNode>();
  std::vector<bool> seen(itemsOf(nodes), false);
  // A node has one parent (section 3.5.2). Each is marked where it is first named, so that the lists of a hostile
  // document, however long, leave no more behind than there are nodes.
  const auto meet = [&](std::uint64_t index) -> base::Result<void> {
    if (index >= seen.size()) return invalidInput("a scene or node names a node that is not there");
    if (seen[index]) return invalidInput("node " + std::to_string(index) + " has two parents or is its own child");
    seen[index] = true;
    return {};
  };

  std::vector<ShownNode> shown, stack;
  const std::vector<std::uint64_t> roots = rootNodes(document);
  for (const std::uint64_t root : roots) LUMIGRID_TRY(meet(root));
  for (std::size_t r = roots.size(); r-- > 0;) stack.push_back({roots[r], kMissing});
  while (!stack.empty()) {
    const ShownNode node = stack.back();
    stack.pop_back();
    const std::uint64_t place = shown.size();
    shown.push_back(node);
    const json& children = member(nodes[node.index], "children");
    for (std::size_t c = itemsOf(children); c-- > 0;) {
      const std::uint64_t child = integer(children[c], kMissing);
      LUMIGRID_TRY(meet(child));
      stack.push_back({child, place});
    }
  }
  return shown;
}

base::Result<void> checkTimesShown(const Amount& shown, const Amount& held) {
  const auto isBeyond = [](double all, double own) { return all > kMaxShownFreely && all > kMaxTimesShown * own; };
  const bool by_triangles = isBeyond(shown.triangles, held.triangles);
  if (!by_triangles && !isBeyond(shown.vertices, held.vertices)) return {};
  const std::string kind = by_triangles ? " triangles" : " vertices";
  return unsupported("instances make " + wholeNumber(by_triangles ? shown.triangles : shown.vertices) + kind +
                     " of the " + wholeNumber(by_triangles ? held.triangles : held.vertices) +
                     " that the file holds; up to " + wholeNumber(kMaxShownFreely) + ", or " +
                     wholeNumber(kMaxTimesShown) +
                     " times those in the file, are read; write fewer instances, or all of them as meshes");
}

}  // namespace mesh::gltf
