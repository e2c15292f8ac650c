#include "lod/draw/hlod_nodes.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

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

template <class Index>
base::gl::Buffer indexBuffer(const hlod::NodePicture& picture) {
  std::vector<Index> indices;
  indices.reserve(picture.triangles.size() + picture.edges.size());
  for (const auto* list : {&picture.triangles, &picture.edges})
    for (const std::uint32_t index : *list) indices.push_back(static_cast<Index>(index));
  base::gl::Buffer buffer = base::gl::Buffer::create();
  base::gl::allocate(buffer, GL_ELEMENT_ARRAY_BUFFER, indices.data(), indices.size() * sizeof(Index), GL_STATIC_DRAW);
  return buffer;
}

}  // namespace

NodeRenderer::Mesh NodeRenderer::upload(const hlod::NodePicture& picture) {
  Mesh mesh;
  mesh.array = base::gl::VertexArray::create();
  glBindVertexArray(mesh.array.name());
  mesh.vertices = base::gl::Buffer::create();
  base::gl::allocate(mesh.vertices, GL_ARRAY_BUFFER, picture.vertices.data(),
                     picture.vertices.size() * sizeof(SurfaceVertex), GL_STATIC_DRAW);
  describeSurfaceVertices();
  if (picture.vertices.size() <= std::size_t{std::numeric_limits<std::uint16_t>::max()} + 1) {
    mesh.indices = indexBuffer<std::uint16_t>(picture);
  } else {
    mesh.indices = indexBuffer<std::uint32_t>(picture);
    mesh.index_type = GL_UNSIGNED_INT;
  }
  glBindVertexArray(0);
  mesh.bytes = mesh.vertices.bytes() + mesh.indices.bytes();
  return mesh;
}

base::Result<std::unique_ptr<NodeRenderer>> NodeRenderer::create(std::uint64_t gpu_bytes) {
  std::unique_ptr<NodeRenderer> renderer(new NodeRenderer(gpu_bytes));
  if (const auto program = renderer->programs_.link({}); !program) return program.error();
  return renderer;
}

base::Result<NodeCount> NodeRenderer::draw(std::span<const hlod::DrawnNode> nodes, const NodeView& view,
                                           const NodeTarget& target) {
  NodeCount count;
  if (target.empty()) return count;
  meshes_.beginFrame(nodes, upload);
  beginSurfaces(target);
  LUMIGRID_ASSIGN_OR_RETURN(count.triangles, drawPass(Primitive::kTriangles, nodes, view, target));
  LUMIGRID_ASSIGN_OR_RETURN(count.points, drawPass(Primitive::kPoints, nodes, view, target));
  LUMIGRID_ASSIGN_OR_RETURN(count.lines, drawPass(Primitive::kLines, nodes, view, target));
  return count;
}

/// Draws the triangles, the points or the lines of all nodes. Returns how many there are.
base::Result<std::uint64_t> NodeRenderer::drawPass(Primitive primitive, std::span<const hlod::DrawnNode> nodes,
                                                   const NodeView& view, const NodeTarget& target) {
  const SurfacePass pass = SurfacePass::of(primitive, view);
  LUMIGRID_ASSIGN_OR_RETURN(const base::gl::Program* program, programs_.use(pass, view, target));
  glUniform1f(program->uniform("u_point_samples"), 1.0F);
  const float samples_per_pixel = target.samplesPerPixel(view.camera);

  std::uint64_t drawn = 0;
  for (const hlod::DrawnNode& node : nodes) {
    const hlod::NodePicture& picture = *node.picture;
    const std::uint64_t count = countOf(primitive, picture);
    if (count == 0) continue;
    drawn += count;
    const Mesh& mesh = meshes_.mesh(picture);
    glBindVertexArray(mesh.array.name());
    glUniform1f(program->uniform("u_closing"), closingWidth(primitive, picture.error));
    if (pass.resolution) {
      glUniform1f(program->uniform("u_detail"), picture.error);
      glUniform1f(program->uniform("u_hatched"), node.awaits_finer ? 1.0F : 0.0F);
    }
    if (primitive == Primitive::kPoints) {
      glDrawArrays(GL_POINTS, 0, static_cast<GLsizei>(count));
    } else if (primitive == Primitive::kTriangles) {
      glDrawElements(GL_TRIANGLES, static_cast<GLsizei>(3 * count), mesh.index_type, nullptr);
    } else {
      const int copies = copiesOfLines(node, samples_per_pixel);
      glUniform1i(program->uniform("u_copies"), copies);
      const std::size_t index_bytes = mesh.index_type == GL_UNSIGNED_SHORT ? 2 : 4;
      glDrawElementsInstanced(GL_LINES, static_cast<GLsizei>(2 * count), mesh.index_type,
                              bufferOffset(picture.triangles.size() * index_bytes), copies == 1 ? 1 : 2 * copies);
    }
  }
  glBindVertexArray(0);
  return drawn;
}

}  // namespace lod::draw
