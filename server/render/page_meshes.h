#pragma once
// Uploads leaf patches with the pages of their textures, and draws them.
#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <unordered_map>
#include <vector>

#include "base/camera.h"
#include "base/gl/gl.h"
#include "lod/patch/hierarchy.h"
#include "lod/texture/format.h"

namespace server {

/// The vertex attribute of a corner's place on its page, beside those of lod::draw.
inline constexpr GLuint kPageCorner = 3;

/// Patches are drawn without their pages.
inline constexpr int kNoPages = -1;
/// Returns how often a patch's pages are halved before they are drawn: no texel is smaller than a pixel that could show
/// it, wherever on the patch. kNoPages where a texel of the last level that keeps charts apart is smaller than a pixel,
/// so that the vertices' colours show as much. It depends on the eye and on the pixels a unit, not on the direction.
/// `samples`: of a pixel along each side.
int pageReduction(std::span<const lod::texture::PageRecord> pages, const base::Sphere& bounds,
                  const base::Camera& camera, int samples);

/// A page whose picture has been halved.
struct ReducedPage {
  lod::texture::Page page;
  int width = 0, height = 0;  ///< texels of the page as it is stored, which its corners count
};
/// Halves the page's picture so often, as far as its sides are even and its levels last.
ReducedPage reduced(lod::texture::Page page, int times);

/// 24 bytes a corner, no index. A page's triangles are a draw call of their own.
class PageMeshes {
 public:
  explicit PageMeshes(const lod::Lattice& lattice) : lattice_(lattice) {}
  /// The pages' triangles must be the geometry's.
  void upload(std::uint32_t patch, const lod::patch::PatchGeometry& geometry, std::span<const ReducedPage> pages);
  void remove(std::uint32_t patch);
  /// Draws an uploaded patch's pages, halved `times` more: the picture is the same as if they had been uploaded so.
  /// `use(alpha)` puts a program with the uniforms of page.glsl into use and returns
  /// it; with `alpha` one that leaves out what the page says is not there.
  void draw(std::uint32_t patch, int times, const std::function<const base::gl::Program&(bool alpha)>& use) const;
  /// Pictures of several samples a pixel mix mip levels by them: one level for each look-up loses 0.1 to 0.4 dB of 46,
  /// and takes a seventh less time to bake by software GL.
  void setSamples(int samples) { filter_ = samples > 1 ? GL_LINEAR_MIPMAP_NEAREST : GL_LINEAR_MIPMAP_LINEAR; }
  std::uint64_t gpuBytes() const { return bytes_; }
  /// Returns the GPU bytes that a page takes, once it has been reduced so often.
  static std::uint64_t bytesFor(const lod::texture::PageRecord& page, int times);

 private:
  struct Mesh {
    base::gl::VertexArray array;
    base::gl::Buffer corners;
    base::gl::Texture texture;
    GLsizei count = 0;
    glm::vec2 scale{1.0F};  // of stored places to 0..1
    glm::ivec2 size{0};     // texels, as uploaded
    int levels = 1;
    bool alpha = false;
    std::uint64_t bytes = 0;
  };
  Mesh meshOf(const lod::patch::PatchGeometry& geometry, const ReducedPage& reduced) const;

  lod::Lattice lattice_;
  std::unordered_map<std::uint32_t, std::vector<Mesh>> meshes_;
  std::uint64_t bytes_ = 0;
  GLint filter_ = GL_LINEAR_MIPMAP_LINEAR;
};

}  // namespace server
