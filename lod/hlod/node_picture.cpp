#include "lod/hlod/node_picture.h"

#include <utility>

#include "lod/hlod/block.h"

namespace lod::hlod {
namespace {

std::uint64_t bytesOf(std::uint64_t vertices, std::uint64_t triangles, std::uint64_t edges) {
  return sizeof(NodePicture) + vertices * sizeof(SurfaceVertex) + (3 * triangles + 2 * edges) * sizeof(std::uint32_t);
}

}  // namespace

std::shared_ptr<const NodePicture> decodePicture(const Header& header, const Node& node, std::uint32_t number,
                                                 base::ByteView bytes) {
  auto geometry = decodeBlock(bytes, node, {header.colors, false});
  if (!geometry) return nullptr;
  auto picture = std::make_shared<NodePicture>();
  picture->node = number;
  picture->points = node.points;
  picture->error = node.error;
  picture->vertices.reserve(geometry->points.size() + geometry->vertices.size());
  for (const auto* list : {&geometry->points, &geometry->vertices})
    for (const NodeVertex& vertex : *list)
      picture->vertices.push_back(
          surfaceVertex(header.lattice.position(vertex.place * (1 << node.step_bits)), vertex.normal, vertex.color));
  picture->triangles = std::move(geometry->triangles);
  picture->edges = std::move(geometry->edges);
  for (auto* list : {&picture->triangles, &picture->edges})
    for (std::uint32_t& vertex : *list) vertex += node.points;
  return picture;
}

std::uint64_t pictureBytes(const NodePicture& picture) {
  return bytesOf(picture.vertices.size(), picture.triangles.size() / 3, picture.edges.size() / 2);
}

std::uint64_t guessedPictureBytes(const Node& node) {
  return bytesOf(std::uint64_t{node.points} + node.triangles, node.triangles, node.edges);
}

}  // namespace lod::hlod
