#include "server/render/page_meshes.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>

#include "lod/draw/triangles.h"

namespace server {
namespace {

/// A corner of a triangle as the GPU reads it.
struct CornerVertex {
  glm::vec3 position;
  std::array<std::int8_t, 4> normal;
  glm::u8vec4 color;
  glm::u16vec2 place;  // on the page × kCornerSteps
};
static_assert(sizeof(CornerVertex) == 24 && offsetof(CornerVertex, place) == 20);

std::int8_t snorm8(float v) {
  return static_cast<std::int8_t>(std::lround(std::clamp(v, -1.0F, 1.0F) * 127.0F));
}

// How often a page of this size can be halved without a rest.
int halvings(int width, int height) {
  int times = 0;
  for (; width > 1 && height > 1 && width % 2 == 0 && height % 2 == 0; ++times) width /= 2, height /= 2;
  return times;
}

base::Image halved(const base::Image& image) {
  base::Image out(image.width / 2, image.height / 2, image.channels);
  for (int y = 0; y < out.height; ++y) {
    const std::uint8_t* upper = image.at(0, 2 * y);
    const std::uint8_t* lower = image.at(0, 2 * y + 1);
    std::uint8_t* to = out.at(0, y);
    const int c = image.channels;
    for (int x = 0; x < out.width; ++x)
      for (int k = 0; k < c; ++k, ++to) {
        const int at = 2 * x * c + k;
        *to = static_cast<std::uint8_t>((upper[at] + upper[at + c] + lower[at] + lower[at + c] + 2) / 4);
      }
  }
  return out;
}

base::Image withAlpha(const base::Image& image) {
  if (image.channels == 4) return image;
  base::Image out(image.width, image.height, 4);
  for (std::size_t i = 0; i < out.pixels.size() / 4; ++i) {
    std::memcpy(&out.pixels[4 * i], &image.pixels[3 * i], 3);
    out.pixels[4 * i + 3] = 255;
  }
  return out;
}

// Mip levels are made here and not by the GL, so that they are the same on whatever level the upload begins.
base::gl::Texture textureOf(const base::Image& page, int levels) {
  base::gl::Texture texture = base::gl::Texture::create();
  base::gl::allocate2D(texture, GL_TEXTURE_2D, levels, GL_RGBA8, page.width, page.height);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
  base::Image level = withAlpha(page);
  for (int k = 0; k < levels; ++k) {
    if (k > 0) level = halved(level);
    glTexSubImage2D(GL_TEXTURE_2D, k, 0, 0, level.width, level.height, GL_RGBA, GL_UNSIGNED_BYTE, level.pixels.data());
  }
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
  glBindTexture(GL_TEXTURE_2D, 0);
  return texture;
}

void describeCorner() {
  const auto at = [](std::size_t offset) { return reinterpret_cast<const void*>(offset); };
  constexpr GLsizei kStride = sizeof(CornerVertex);
  for (const GLuint attribute :
       {GLuint{lod::draw::kPosition}, GLuint{lod::draw::kNormal}, GLuint{lod::draw::kColor}, kPageCorner})
    glEnableVertexAttribArray(attribute);
  glVertexAttribPointer(lod::draw::kPosition, 3, GL_FLOAT, GL_FALSE, kStride, at(offsetof(CornerVertex, position)));
  glVertexAttribPointer(lod::draw::kNormal, 4, GL_BYTE, GL_TRUE, kStride, at(offsetof(CornerVertex, normal)));
  glVertexAttribPointer(lod::draw::kColor, 4, GL_UNSIGNED_BYTE, GL_TRUE, kStride, at(offsetof(CornerVertex, color)));
  glVertexAttribPointer(kPageCorner, 2, GL_UNSIGNED_SHORT, GL_FALSE, kStride, at(offsetof(CornerVertex, place)));
}

}  // namespace

int pageReduction(std::span<const lod::texture::PageRecord> pages, const base::Sphere& bounds,
                  const base::Camera& camera, int samples) {
  if (pages.empty()) return kNoPages;
  float density = camera.pixelsPerUnitAtOne() * static_cast<float>(samples);
  if (!camera.orthographic())
    density /= std::max(glm::length(bounds.center - camera.eye) - bounds.radius, 1e-6F * bounds.radius + 1e-30F);
  int least = kNoPages;
  int most = 0;
  for (const lod::texture::PageRecord& page : pages) {
    // Level k of a page has texels of 2^k times its own.
    const float octaves = -std::log2(std::max(page.texel * density, 1e-9F));
    if (octaves >= static_cast<float>(page.levels)) continue;
    const int times = std::clamp(static_cast<int>(std::floor(octaves)), 0, page.levels - 1);
    least = least == kNoPages ? times : std::min(least, times);
    most = std::max(most, halvings(page.width, page.height));
  }
  return least == kNoPages ? kNoPages : std::min(least, most);
}

ReducedPage reduced(lod::texture::Page page, int times) {
  ReducedPage out{std::move(page), 0, 0};
  base::Image& image = out.page.image;
  out.width = image.width, out.height = image.height;
  for (; times > 0 && out.page.levels > 1 && halvings(image.width, image.height) > 0; --times, --out.page.levels)
    image = halved(image);
  return out;
}

std::uint64_t PageMeshes::bytesFor(const lod::texture::PageRecord& page, int times) {
  const int shift = std::min({times, static_cast<int>(page.levels) - 1, halvings(page.width, page.height)});
  const std::uint64_t texels = (std::uint64_t{page.width} >> shift) * (std::uint64_t{page.height} >> shift);
  return 4 * texels + 4 * texels / 3 + 3 * sizeof(CornerVertex) * std::uint64_t{page.triangles};
}

PageMeshes::Mesh PageMeshes::meshOf(const lod::patch::PatchGeometry& geometry, const ReducedPage& reduced) const {
  const lod::texture::Page& page = reduced.page;
  std::vector<CornerVertex> corners;
  corners.reserve(3 * page.triangles.size());
  for (const lod::texture::PageTriangle& t : page.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t v = geometry.indices[3 * std::size_t{t.triangle} + k];
      const glm::vec3 n = v < geometry.normals.size() ? geometry.normals[v] : glm::vec3(0.0F);
      corners.push_back({lattice_.position(geometry.positions[v]),
                         {snorm8(n.x), snorm8(n.y), snorm8(n.z), 0},
                         v < geometry.colors.size() ? geometry.colors[v] : glm::u8vec4(255),
                         t.corners[k]});
    }
  Mesh mesh;
  mesh.array = base::gl::VertexArray::create();
  mesh.corners = base::gl::Buffer::create();
  mesh.count = static_cast<GLsizei>(corners.size());
  glBindVertexArray(mesh.array.name());
  base::gl::allocate(mesh.corners, GL_ARRAY_BUFFER, corners.data(), corners.size() * sizeof(CornerVertex),
                     GL_STATIC_DRAW);
  describeCorner();
  glBindVertexArray(0);
  mesh.size = {page.image.width, page.image.height};
  mesh.levels = std::min(static_cast<int>(page.levels), halvings(page.image.width, page.image.height) + 1);
  mesh.texture = textureOf(page.image, mesh.levels);
  mesh.scale = 1.0F / (static_cast<float>(lod::texture::kCornerSteps) * glm::vec2(reduced.width, reduced.height));
  mesh.alpha = page.image.channels == 4;
  mesh.bytes = mesh.corners.bytes() + mesh.texture.bytes();
  return mesh;
}

void PageMeshes::upload(std::uint32_t patch, const lod::patch::PatchGeometry& geometry,
                        std::span<const ReducedPage> pages) {
  remove(patch);
  std::vector<Mesh>& meshes = meshes_[patch];
  for (const ReducedPage& page : pages) {
    meshes.push_back(meshOf(geometry, page));
    bytes_ += meshes.back().bytes;
  }
}

void PageMeshes::remove(std::uint32_t patch) {
  const auto found = meshes_.find(patch);
  if (found == meshes_.end()) return;
  for (const Mesh& mesh : found->second) bytes_ -= mesh.bytes;
  meshes_.erase(found);
}

void PageMeshes::draw(std::uint32_t patch, int times,
                      const std::function<const base::gl::Program&(bool alpha)>& use) const {
  const auto found = meshes_.find(patch);
  LUMIGRID_CHECK(found != meshes_.end());
  for (const Mesh& mesh : found->second) {
    const base::gl::Program& program = use(mesh.alpha);
    const int first = std::min(times, mesh.levels - 1);
    glUniform2f(program.uniform("u_page_scale"), mesh.scale.x, mesh.scale.y);
    glUniform2f(program.uniform("u_page_size"), static_cast<float>(mesh.size.x >> first),
                static_cast<float>(mesh.size.y >> first));
    glUniform1f(program.uniform("u_last_level"), static_cast<float>(mesh.levels - 1 - first));
    glBindTexture(GL_TEXTURE_2D, mesh.texture.name());
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_BASE_LEVEL, first);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, filter_);
    glBindVertexArray(mesh.array.name());
    glDrawArrays(GL_TRIANGLES, 0, mesh.count);
  }
  glBindVertexArray(0);
  glBindTexture(GL_TEXTURE_2D, 0);
}

}  // namespace server
