#include "lod/draw/umbrellas.h"

#include <utility>
#include <vector>

#include "lod/draw/near_fit.h"

namespace lod::draw {
namespace {

// Each place in a triangle is at most this share of the longest edge away from a corner, so discs of that radius around
// the corners cover it.
constexpr float kClosingShare = 0.5774F;

base::gl::Buffer indexBuffer(const std::vector<std::uint16_t>& indices) {
  base::gl::Buffer buffer = base::gl::Buffer::create();
  base::gl::allocate(buffer, GL_ELEMENT_ARRAY_BUFFER, indices.data(), indices.size() * sizeof(std::uint16_t),
                     GL_STATIC_DRAW);
  return buffer;
}

}  // namespace

UmbrellaRenderer::Mesh UmbrellaRenderer::meshOf(const pmr::LeafPicture& picture) {
  Mesh mesh;
  mesh.mean_radius = pmr::meanRadius(picture.list);
  mesh.vertices = base::gl::Buffer::create();
  base::gl::allocate(mesh.vertices, GL_ARRAY_BUFFER, picture.vertices.data(),
                     picture.vertices.size() * sizeof(SurfaceVertex), GL_STATIC_DRAW);
  const auto describe = [](base::gl::VertexArray& array, base::gl::Buffer& indices,
                           const std::vector<std::uint16_t>& list) {
    array = base::gl::VertexArray::create();
    glBindVertexArray(array.name());
    describeSurfaceVertices();
    indices = indexBuffer(list);
    glBindVertexArray(0);
  };
  describe(mesh.points_array, mesh.points, picture.list.points);
  describe(mesh.triangles_array, mesh.corners, picture.list.corners);
  for (const SurfaceVertex& vertex : picture.vertices) mesh.box.add(vertex.position);
  mesh.bytes = mesh.vertices.bytes() + mesh.points.bytes() + mesh.corners.bytes();
  return mesh;
}

base::Result<std::unique_ptr<UmbrellaRenderer>> UmbrellaRenderer::create(std::uint64_t gpu_bytes) {
  std::unique_ptr<UmbrellaRenderer> renderer(new UmbrellaRenderer(gpu_bytes));
  // Programs that a later picture links would wait until all before it is drawn.
  for (const Primitive primitive : {Primitive::kTriangles, Primitive::kPoints})
    if (const auto program = renderer->programs_.link({.primitive = primitive}); !program) return program.error();
  return renderer;
}

base::Camera UmbrellaRenderer::fitted(const base::Camera& camera, std::span<const pmr::DrawnLeaf> leaves) const {
  NearFit fit(camera);
  for (const pmr::DrawnLeaf& leaf : leaves)
    if (!fit.add(meshes_.mesh(*leaf.picture).box)) fit.keepNear();
  return fit.camera();
}

base::Result<UmbrellaCount> UmbrellaRenderer::draw(std::span<const pmr::DrawnLeaf> leaves, const UmbrellaView& from,
                                                   const SurfaceTarget& target) {
  UmbrellaCount count;
  if (target.empty()) return count;
  meshes_.beginFrame(leaves, meshOf);
  UmbrellaView view = from;
  view.camera = drawn_camera_ = fitted(from.camera, leaves);
  beginSurfaces(target);
  LUMIGRID_ASSIGN_OR_RETURN(count.triangles, drawPass(Primitive::kTriangles, leaves, view, target));
  LUMIGRID_ASSIGN_OR_RETURN(count.points, drawPass(Primitive::kPoints, leaves, view, target));
  return count;
}

/// Sorts the mesh's triangles when a part of them is drawn for the first time.
pmr::DrawnPart UmbrellaRenderer::trianglesToDraw(Mesh& mesh, const pmr::DrawnLeaf& leaf) {
  const pmr::DrawList& list = leaf.picture->list;
  if (list.drawsAllTriangles(leaf.pixel)) return {0, static_cast<std::uint32_t>(list.corners.size() / 3)};
  if (mesh.reaches.empty()) {
    pmr::SortedTriangles sorted = pmr::sortedTriangles(list, leaf.picture->vertices.size());
    glBindVertexArray(mesh.triangles_array.name());
    base::gl::allocate(mesh.corners, GL_ELEMENT_ARRAY_BUFFER, sorted.corners.data(),
                       sorted.corners.size() * sizeof(std::uint16_t), GL_STATIC_DRAW);
    mesh.reaches = std::move(sorted.reaches);
  }
  return {0, pmr::countUmbrellas(mesh.reaches, leaf.pixel)};
}

/// Draws the triangles or the points of all leaves. Returns how many there are.
base::Result<std::uint64_t> UmbrellaRenderer::drawPass(Primitive primitive, std::span<const pmr::DrawnLeaf> leaves,
                                                       const UmbrellaView& view, const SurfaceTarget& target) {
  const SurfacePass pass = SurfacePass::of(primitive, view);
  LUMIGRID_ASSIGN_OR_RETURN(const base::gl::Program* program, programs_.use(pass, view, target));
  glUniform1i(program->uniform("u_two_sided"), !view.oriented || pass.section ? 1 : 0);
  glUniform1f(program->uniform("u_point_samples"), target.samplesPerPixel(view.camera));

  const bool are_points = primitive == Primitive::kPoints;
  std::uint64_t drawn = 0;
  for (const pmr::DrawnLeaf& leaf : leaves) {
    const pmr::DrawList& list = leaf.picture->list;
    Mesh& mesh = meshes_.mesh(*leaf.picture);
    const pmr::DrawnPart part = are_points ? list.pointsAt(leaf.pixel) : trianglesToDraw(mesh, leaf);
    if (part.count() == 0) continue;
    if (are_points) glUniform1f(program->uniform("u_closing"), 2.0F * kClosingShare * list.point_radii[part.first]);
    if (pass.resolution) {
      glUniform1f(program->uniform("u_detail"), 2.0F * mesh.mean_radius);
      glUniform1f(program->uniform("u_hatched"), leaf.wanted < leaf.picture->level ? 1.0F : 0.0F);
    }
    drawn += part.count();
    const std::size_t corners = are_points ? 1 : 3;
    glBindVertexArray(are_points ? mesh.points_array.name() : mesh.triangles_array.name());
    glDrawElements(are_points ? GL_POINTS : GL_TRIANGLES, static_cast<GLsizei>(corners * part.count()),
                   GL_UNSIGNED_SHORT, bufferOffset(corners * part.first * sizeof(std::uint16_t)));
  }
  glBindVertexArray(0);
  return drawn;
}

}  // namespace lod::draw
