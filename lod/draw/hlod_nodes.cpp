#include "lod/draw/hlod_nodes.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "lod/draw/near_fit.h"

namespace lod::draw {
namespace {

// A line covers the samples that are at most half a sample above or beside it, and so the less across it, down to
// 1 / √2 of that, the nearer it is to a diagonal.
constexpr float kDiagonal = 1.4142F;
// The most copies of a line to either side: a crack of a node that is shown while finer ones come may be wider.
constexpr int kMaxCopies = 16;

/// How wide lines must be, or points, to reach as far as the node's error to all sides.
float closingWidth(Primitive primitive, float error) {
  if (primitive == Primitive::kPoints) return 2.0F * error;
  return primitive == Primitive::kLines ? 2.0F * kDiagonal * error : 0.0F;
}

/// The copies of each line that make it as wide as it must be where it is nearest.
int copiesOfLines(const hlod::DrawnNode& node, float samples_per_pixel) {
  const float width = closingWidth(Primitive::kLines, node.error_px) * samples_per_pixel;
  // Errors may be infinite.
  return width < static_cast<float>(kMaxCopies) ? std::max(1, static_cast<int>(std::ceil(width))) : kMaxCopies;
}

std::uint64_t countOf(Primitive primitive, const hlod::NodePicture& picture) {
  switch (primitive) {
    case Primitive::kTriangles:
      return picture.triangles.size() / 3;
    case Primitive::kPoints:
      return picture.points;
    case Primitive::kLines:
      break;
  }
  return picture.edges.size() / 2;
}

void addTriangles(const hlod::NodePicture& picture, NearFit& fit) {
  const auto place = [&](std::uint32_t vertex) { return picture.vertices[vertex].position; };
  const std::vector<std::uint32_t>& corners = picture.triangles;
  for (std::uint32_t i = 0; i < picture.points; ++i) fit.addTriangle(place(i), place(i), place(i));
  for (std::size_t i = 0; i + 2 < corners.size(); i += 3)
    fit.addTriangle(place(corners[i]), place(corners[i + 1]), place(corners[i + 2]));
}

}  // namespace

float shadowReach(const base::Aabb& box, float error, std::span<const DrawnCaster> casters,
                  std::span<const hlod::Node> nodes) {
  float largest = 0.0F;
  for (const DrawnCaster& caster : casters) {
    const base::Aabb& other = nodes[caster.picture->node].box;
    const float apart = error + caster.picture->error;
    const bool is_beside = glm::all(glm::lessThanEqual(other.min - apart, box.max)) &&
                           glm::all(glm::greaterThanEqual(other.max + apart, box.min));
    if (is_beside) largest = std::max(largest, caster.picture->error);
  }
  return error + largest;
}

NodeRenderer::Mesh NodeRenderer::meshOf(const hlod::NodePicture& picture) {
  Mesh mesh;
  mesh.array = base::gl::VertexArray::create();
  glBindVertexArray(mesh.array.name());
  mesh.vertices = base::gl::Buffer::create();
  base::gl::allocate(mesh.vertices, GL_ARRAY_BUFFER, picture.vertices.data(),
                     picture.vertices.size() * sizeof(SurfaceVertex), GL_STATIC_DRAW);
  describeSurfaceVertices();
  mesh.indices = uploadIndices(picture.vertices.size(), {picture.triangles, picture.edges});
  glBindVertexArray(0);
  for (const SurfaceVertex& vertex : picture.vertices) mesh.box.add(vertex.position);
  mesh.bytes = mesh.vertices.bytes() + mesh.indices.buffer.bytes();
  return mesh;
}

base::Result<std::unique_ptr<NodeRenderer>> NodeRenderer::create(std::uint64_t gpu_bytes) {
  std::unique_ptr<NodeRenderer> renderer(new NodeRenderer(gpu_bytes));
  if (const auto program = renderer->programs_.link({}); !program) return program.error();
  return renderer;
}

base::Camera NodeRenderer::fitted(const base::Camera& camera, std::span<const hlod::DrawnNode> nodes) const {
  NearFit fit(camera);
  for (const hlod::DrawnNode& node : nodes)
    if (!fit.add(meshes_.mesh(*node.picture).box)) addTriangles(*node.picture, fit);
  return fit.camera();
}

base::Result<NodeCount> NodeRenderer::draw(std::span<const hlod::DrawnNode> nodes, const NodeView& from,
                                           const NodeTarget& target, const NodeShadows* shadows) {
  NodeCount count;
  if (target.empty()) return count;
  meshes_.beginFrame(nodes, meshOf);
  NodeView view = from;
  view.camera = drawn_camera_ = fitted(from.camera, nodes);
  if (shadows != nullptr) {
    LUMIGRID_TRY(drawShadowed(nodes, view, target, *shadows, count));
    return count;
  }
  Group all;
  for (const hlod::DrawnNode& node : nodes) all.nodes.push_back(&node);
  LUMIGRID_TRY(drawGroup(all, view, target, count));
  return count;
}

base::Result<void> NodeRenderer::drawMap(const NodeShadowMap& map, const NodeShadows& shadows, std::size_t slot) {
  if (!shadow_map_) {
    LUMIGRID_ASSIGN_OR_RETURN(shadow_map_, ShadowMap::create(gpu_bytes_));
  }
  shadow_map_->setKeptBytes(shadows.kept_bytes);
  return shadow_map_->draw({map.plan.camera, shadows.light, map.plan.region, map.plan.slice}, map.casters, slot);
}

/// Draws the nodes map by map; those in none come last, under a map without casters.
base::Result<void> NodeRenderer::drawShadowed(std::span<const hlod::DrawnNode> nodes, const NodeView& view,
                                              const NodeTarget& target, const NodeShadows& shadows, NodeCount& count) {
  std::vector<std::uint32_t> maps(nodes.size(), 0);  // of each node
  for (const NodeShadowMap& map : shadows.maps)
    for (const std::uint32_t place : map.plan.receivers) ++maps[place];
  const auto drawReceivers = [&](const NodeShadowMap& map, std::size_t slot) -> base::Result<void> {
    Group group;
    for (const std::uint32_t place : map.plan.receivers) {
      const hlod::Node& row = shadows.nodes[nodes[place].picture->node];
      group.nodes.push_back(&nodes[place]);
      group.in_shadow.push_back({shadowReach(row.box, row.shape_error, map.casters, shadows.nodes), maps[place] > 1});
    }
    LUMIGRID_TRY(drawMap(map, shadows, slot));
    group.shadow_layers = shadow_map_->layers();
    return drawGroup(group, view, target, count);
  };
  // Maps that nobody keeps take turns in one texture. The empty one has another, or that would shrink.
  const bool keeps = shadows.kept_bytes > 0;
  for (std::size_t i = 0; i < shadows.maps.size(); ++i) LUMIGRID_TRY(drawReceivers(shadows.maps[i], keeps ? i : 0));
  NodeShadowMap lit;
  for (std::uint32_t i = 0; i < nodes.size(); ++i)
    if (maps[i] == 0) lit.plan.receivers.push_back(i);
  return lit.plan.receivers.empty() ? base::Result<void>{} : drawReceivers(lit, keeps ? shadows.maps.size() : 1);
}

base::Result<void> NodeRenderer::drawGroup(const Group& group, const NodeView& view, const NodeTarget& target,
                                           NodeCount& count) {
  beginSurfaces(target);
  for (const auto& [primitive, drawn] :
       {std::pair(Primitive::kTriangles, &count.triangles), std::pair(Primitive::kPoints, &count.points),
        std::pair(Primitive::kLines, &count.lines)}) {
    LUMIGRID_ASSIGN_OR_RETURN(const std::uint64_t more, drawPass(primitive, group, view, target));
    *drawn += more;
  }
  if (group.shadow_layers > 0) ShadowMap::endUse();
  return {};
}

/// Draws the triangles, the points or the lines of the group's nodes. Returns how many there are.
base::Result<std::uint64_t> NodeRenderer::drawPass(Primitive primitive, const Group& group, const NodeView& view,
                                                   const NodeTarget& target) {
  SurfacePass pass = SurfacePass::of(primitive, view);
  pass.shadow_layers = group.shadow_layers;
  LUMIGRID_ASSIGN_OR_RETURN(const base::gl::Program* program, programs_.use(pass, view, target));
  glUniform1f(program->uniform("u_point_samples"), 1.0F);
  const float samples_per_pixel = target.samplesPerPixel(view.camera);
  const glm::vec4 eye = view.camera.homogeneousEye();
  if (group.shadow_layers > 0) shadow_map_->use(*program, eye.w * glm::vec3(eye));

  std::uint64_t drawn = 0;
  for (std::size_t i = 0; i < group.nodes.size(); ++i) {
    const hlod::DrawnNode& node = *group.nodes[i];
    const hlod::NodePicture& picture = *node.picture;
    const std::uint64_t count = countOf(primitive, picture);
    if (count == 0) continue;
    drawn += count;
    const Mesh& mesh = meshes_.mesh(picture);
    glBindVertexArray(mesh.array.name());
    glUniform1f(program->uniform("u_closing"), closingWidth(primitive, picture.error));
    glUniform1f(program->uniform("u_back"), 2.0F * picture.error);
    if (pass.shadow_layers > 0) {
      glUniform1f(program->uniform("u_reach"), group.in_shadow[i].reach);
      glUniform1i(program->uniform("u_one_of_several"), group.in_shadow[i].one_of_several ? 1 : 0);
    }
    if (pass.resolution) {
      glUniform1f(program->uniform("u_detail"), picture.error);
      glUniform1f(program->uniform("u_hatched"), node.awaits_finer ? 1.0F : 0.0F);
    }
    if (primitive == Primitive::kPoints) {
      glDrawArrays(GL_POINTS, 0, static_cast<GLsizei>(count));
    } else if (primitive == Primitive::kTriangles) {
      glDrawElements(GL_TRIANGLES, static_cast<GLsizei>(3 * count), mesh.indices.type, nullptr);
    } else {
      const int copies = copiesOfLines(node, samples_per_pixel);
      glUniform1i(program->uniform("u_copies"), copies);
      glDrawElementsInstanced(GL_LINES, static_cast<GLsizei>(2 * count), mesh.indices.type,
                              bufferOffset(mesh.indices.bytesOf(picture.triangles.size())),
                              copies == 1 ? 1 : 2 * copies);
    }
  }
  glBindVertexArray(0);
  return drawn;
}

}  // namespace lod::draw
