#include "lod/draw/umbrellas.h"

#include <algorithm>
#include <numeric>
#include <string>
#include <vector>

#include "lod/draw/shaders.h"
#include "lod/draw/view_modes.h"

namespace lod::draw {
namespace {

// Each place in a triangle is at most this share of the longest edge away from a corner, so discs of that radius around
// the corners cover it.
constexpr float kClosingShare = 0.5774F;

const void* bufferOffset(std::size_t bytes) {
  return reinterpret_cast<const void*>(bytes);
}

base::gl::Buffer indexBuffer(const std::vector<std::uint16_t>& indices) {
  base::gl::Buffer buffer = base::gl::Buffer::create();
  base::gl::allocate(buffer, GL_ELEMENT_ARRAY_BUFFER, indices.data(), indices.size() * sizeof(std::uint16_t),
                     GL_STATIC_DRAW);
  return buffer;
}

float samplesPerUnit(const UmbrellaView& view, const UmbrellaTarget& target) {
  const glm::mat4& lens = view.camera.clip_from_eye;
  return 0.5F * std::max(static_cast<float>(target.width) * lens[0][0], static_cast<float>(target.height) * lens[1][1]);
}

}  // namespace

// ---- Leaves on the GPU ----

UmbrellaRenderer::Mesh UmbrellaRenderer::upload(const std::shared_ptr<const pmr::LeafPicture>& picture) {
  static_assert(sizeof(pmr::Vertex) == kSurfaceVertexBytes);
  Mesh mesh;
  mesh.picture = picture;
  mesh.mean_radius = pmr::meanRadius(picture->list);
  mesh.vertices = base::gl::Buffer::create();
  base::gl::allocate(mesh.vertices, GL_ARRAY_BUFFER, picture->vertices.data(),
                     picture->vertices.size() * sizeof(pmr::Vertex), GL_STATIC_DRAW);
  const auto describe = [](base::gl::VertexArray& array, base::gl::Buffer& indices,
                           const std::vector<std::uint16_t>& list) {
    array = base::gl::VertexArray::create();
    glBindVertexArray(array.name());
    describeSurfaceVertices();
    indices = indexBuffer(list);
    glBindVertexArray(0);
  };
  describe(mesh.points_array, mesh.points, picture->list.points);
  describe(mesh.triangles_array, mesh.corners, picture->list.corners);
  mesh.bytes = mesh.vertices.bytes() + mesh.points.bytes() + mesh.corners.bytes();
  return mesh;
}

/// Uploads the leaves that are not on the GPU yet.
void UmbrellaRenderer::prepare(std::span<const pmr::DrawnLeaf> leaves) {
  ++frame_;
  for (const pmr::DrawnLeaf& leaf : leaves) {
    Mesh& mesh = meshes_[leaf.picture.get()];
    // Another picture may have come to lie where one was that is gone.
    if (mesh.picture.lock() != leaf.picture) {
      bytes_ -= mesh.bytes;
      mesh = upload(leaf.picture);
      bytes_ += mesh.bytes;
    }
    mesh.last_use = frame_;
  }
}

void UmbrellaRenderer::dropUnused() {
  std::vector<std::pair<std::uint64_t, const pmr::LeafPicture*>> unused;
  for (auto it = meshes_.begin(); it != meshes_.end();) {
    const Mesh& mesh = it->second;
    if (mesh.picture.expired()) {
      bytes_ -= mesh.bytes;
      it = meshes_.erase(it);
      continue;
    }
    if (mesh.last_use != frame_) unused.emplace_back(mesh.last_use, it->first);
    ++it;
  }
  if (bytes_ <= gpu_bytes_) return;
  std::sort(unused.begin(), unused.end());
  for (const auto& [use, picture] : unused) {
    if (bytes_ <= gpu_bytes_) return;
    const auto found = meshes_.find(picture);
    bytes_ -= found->second.bytes;
    meshes_.erase(found);
  }
}

// ---- Programs ----

struct UmbrellaRenderer::Pass {
  bool points = false;
  bool resolution = false;  ///< coloured by resolution
  bool section = false;

  std::size_t number() const { return (points ? 4U : 0U) + (resolution ? 2U : 0U) + (section ? 1U : 0U); }
  std::string defines() const {
    return std::string(points ? "#define POINTS\n" : "") + (resolution ? "#define RESOLUTION\n" : "") +
           (section ? "#define SECTION\n" : "");
  }
};

base::Result<std::unique_ptr<UmbrellaRenderer>> UmbrellaRenderer::create(std::uint64_t gpu_bytes) {
  std::unique_ptr<UmbrellaRenderer> renderer(new UmbrellaRenderer);
  renderer->gpu_bytes_ = gpu_bytes;
  if (const auto program = renderer->program({}); !program) return program.error();
  return renderer;
}

base::Result<const base::gl::Program*> UmbrellaRenderer::program(const Pass& pass) {
  base::gl::Program& cached = programs_[pass.number()];
  if (cached.name() != 0) return &cached;
  const std::string defines = pass.defines();
  const std::string vertex = defines + shadingSource() + tintSource() + glsl::kUmbrellaVertex;
  LUMIGRID_ASSIGN_OR_RETURN(cached, base::gl::Program::link("umbrellas", vertex, defines + glsl::kUmbrellaFragment));
  return &cached;
}

// ---- Drawing ----

base::Result<UmbrellaCount> UmbrellaRenderer::draw(std::span<const pmr::DrawnLeaf> leaves, const UmbrellaView& view,
                                                   const UmbrellaTarget& target) {
  UmbrellaCount count;
  if (target.width <= 0 || target.height <= 0) return count;
  prepare(leaves);
  dropUnused();
  glDisable(GL_SCISSOR_TEST);
  glDisable(GL_CULL_FACE);
  glDisable(GL_BLEND);
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_LESS);
  glDepthMask(GL_TRUE);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glBindFramebuffer(GL_FRAMEBUFFER, target.framebuffer);
  glViewport(0, 0, target.width, target.height);

  Pass pass;
  pass.resolution = view.resolution_colors;
  pass.section = glm::vec3(view.section) != glm::vec3(0.0F);
  LUMIGRID_ASSIGN_OR_RETURN(count.triangles, drawPass(pass, leaves, view, target));
  pass.points = true;
  LUMIGRID_ASSIGN_OR_RETURN(count.points, drawPass(pass, leaves, view, target));
  return count;
}

/// Draws the triangles or the points of all leaves. Returns how many there are.
base::Result<std::uint64_t> UmbrellaRenderer::drawPass(const Pass& pass, std::span<const pmr::DrawnLeaf> leaves,
                                                       const UmbrellaView& view, const UmbrellaTarget& target) {
  LUMIGRID_ASSIGN_OR_RETURN(const base::gl::Program* found, program(pass));
  const base::gl::Program& used = *found;
  setShading(used, view.shading);
  const glm::mat4 clip_from_scene = view.camera.clipFromScene();
  const glm::vec4 eye = view.camera.homogeneousEye();
  glUniformMatrix4fv(used.uniform("u_clip_from_scene"), 1, GL_FALSE, &clip_from_scene[0][0]);
  glUniform4f(used.uniform("u_eye"), eye.x, eye.y, eye.z, eye.w);
  glUniform1i(used.uniform("u_two_sided"), !view.oriented || pass.section ? 1 : 0);
  glUniform4f(used.uniform("u_section"), view.section.x, view.section.y, view.section.z, view.section.w);
  glUniform1f(used.uniform("u_samples"), samplesPerUnit(view, target));
  glUniform1f(used.uniform("u_point_samples"),
              static_cast<float>(target.height) / static_cast<float>(std::max(view.camera.height, 1)));
  if (pass.resolution) {
    setTint(used);
    glUniform1f(used.uniform("u_pixels"), view.camera.pixelsPerUnitAtOne());
  }

  std::uint64_t drawn = 0;
  for (const pmr::DrawnLeaf& leaf : leaves) {
    const pmr::DrawList& list = leaf.picture->list;
    const pmr::DrawnPart part = pass.points ? list.pointsAt(leaf.pixel) : list.trianglesAt(leaf.pixel);
    if (part.count() == 0) continue;
    const Mesh& mesh = meshes_.find(leaf.picture.get())->second;
    if (pass.points) glUniform1f(used.uniform("u_closing"), 2.0F * kClosingShare * list.point_radii[part.first]);
    if (pass.resolution) {
      glUniform1f(used.uniform("u_diameter"), 2.0F * mesh.mean_radius);
      glUniform1f(used.uniform("u_hatched"), leaf.wanted < leaf.picture->level ? 1.0F : 0.0F);
    }
    drawn += part.count();
    const std::size_t corners = pass.points ? 1 : 3;
    glBindVertexArray(pass.points ? mesh.points_array.name() : mesh.triangles_array.name());
    glDrawElements(pass.points ? GL_POINTS : GL_TRIANGLES, static_cast<GLsizei>(corners * part.count()),
                   GL_UNSIGNED_SHORT, bufferOffset(corners * part.first * sizeof(std::uint16_t)));
  }
  glBindVertexArray(0);
  return drawn;
}

}  // namespace lod::draw
