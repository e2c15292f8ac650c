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

std::shared_ptr<const CasterPicture> decodeCaster(const Header& header, const Node& node, std::uint32_t number,
                                                  base::ByteView bytes) {
  auto geometry = decodeBlock(bytes, node, {header.colors, !node.isLeaf()});
  if (!geometry) return nullptr;
  auto caster = std::make_shared<CasterPicture>();
  caster->node = number;
  caster->error = node.caster_error;
  caster->positions.reserve(geometry->vertices.size());
  for (const NodeVertex& vertex : geometry->vertices)
    caster->positions.push_back(header.lattice.position(vertex.place * (1 << node.step_bits)));
  caster->triangles = std::move(geometry->triangles);
  return caster;
}

std::shared_ptr<const CasterPicture> casterOfLeaf(const NodePicture& picture) {
  auto caster = std::make_shared<CasterPicture>();
  caster->node = picture.node;
  for (std::size_t i = picture.points; i < picture.vertices.size(); ++i)
    caster->positions.push_back(picture.vertices[i].position);
  caster->triangles = picture.triangles;
  for (std::uint32_t& vertex : caster->triangles) vertex -= picture.points;
  return caster;
}

std::uint64_t casterBytes(const CasterPicture& caster) {
  return sizeof(CasterPicture) + caster.positions.size() * sizeof(glm::vec3) +
         caster.triangles.size() * sizeof(std::uint32_t);
}

std::uint64_t guessedCasterBytes(const Node& node) {
  const std::uint64_t triangles = node.isLeaf() ? node.triangles : node.caster_triangles;
  return sizeof(CasterPicture) + triangles * (sizeof(glm::vec3) + 3 * sizeof(std::uint32_t));
}

}  // namespace lod::hlod
