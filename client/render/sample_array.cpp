#include "client/render/sample_array.h"

#include <algorithm>

#include "client/render/pyramid.h"

namespace client {
namespace {

void setFilters(GLint minify, GLint magnify) {
  glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, minify);
  glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAG_FILTER, magnify);
  glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
  glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
}

int maxLayers() {
  GLint layers = 0;
  glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers);
  return layers;
}

}  // namespace

SampleArray::SampleArray(int width, int height, int depth_width, int depth_height, int whole_up_to_layers)
    : width_(width),
      height_(height),
      depth_width_(depth_width),
      depth_height_(depth_height),
      whole_up_to_layers_(whole_up_to_layers),
      framebuffer_(base::gl::Framebuffer::create()) {}

std::uint64_t SampleArray::bytesPerLayer() const {
  return pyramidBytes(width_, height_) +
         std::uint64_t{4} * static_cast<std::uint64_t>(depth_width_) * static_cast<std::uint64_t>(depth_height_);
}

base::gl::Texture SampleArray::makeColor(int layers) const {
  auto texture = base::gl::Texture::create();
  base::gl::allocate3D(texture, GL_TEXTURE_2D_ARRAY, pyramidLevels(width_, height_), GL_RGBA8, width_, height_, layers);
  setFilters(GL_LINEAR_MIPMAP_LINEAR, GL_LINEAR);
  return texture;
}

base::gl::Texture SampleArray::makeDepth(int layers) const {
  auto texture = base::gl::Texture::create();
  base::gl::allocate3D(texture, GL_TEXTURE_2D_ARRAY, 1, GL_DEPTH_COMPONENT24, depth_width_, depth_height_, layers);
  setFilters(GL_LINEAR, GL_LINEAR);
  glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_COMPARE_MODE, GL_COMPARE_REF_TO_TEXTURE);
  glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_COMPARE_FUNC, GL_LEQUAL);
  return texture;
}

void SampleArray::copyLayersTo(const base::gl::Texture& color, const base::gl::Texture& depth) const {
  const auto from = base::gl::Framebuffer::create();
  const auto to = base::gl::Framebuffer::create();
  glBindFramebuffer(GL_READ_FRAMEBUFFER, from.name());
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, to.name());

  // Everything is blitted: GL does not copy into depth textures, and copying colour by glCopyTexSubImage3D took 4 ms a
  // level of 256 x 256 texels on an NVIDIA GPU, seconds for a whole array.
  const auto blit = [](GLenum attachment, GLbitfield mask, const base::gl::Texture& source,
                       const base::gl::Texture& target, int level, int layer, int width, int height) {
    glFramebufferTextureLayer(GL_READ_FRAMEBUFFER, attachment, source.name(), level, layer);
    glFramebufferTextureLayer(GL_DRAW_FRAMEBUFFER, attachment, target.name(), level, layer);
    glBlitFramebuffer(0, 0, width, height, 0, 0, width, height, mask, GL_NEAREST);
  };
  for (int level = 0; level < pyramidLevels(width_, height_); ++level)
    for (int layer = 0; layer < capacity_; ++layer)
      blit(GL_COLOR_ATTACHMENT0, GL_COLOR_BUFFER_BIT, color_, color, level, layer, std::max(1, width_ >> level),
           std::max(1, height_ >> level));

  for (const GLenum target : {GL_READ_FRAMEBUFFER, GL_DRAW_FRAMEBUFFER})
    glFramebufferTextureLayer(target, GL_COLOR_ATTACHMENT0, 0, 0, 0);
  for (int layer = 0; layer < capacity_; ++layer)
    blit(GL_DEPTH_ATTACHMENT, GL_DEPTH_BUFFER_BIT, depth_, depth, 0, layer, depth_width_, depth_height_);
}

int LayerGrowth::after(int capacity) const {
  // While layers are copied, old and new ones take memory. Where few are affordable anyway, all are allocated at once.
  const int wanted = capacity > 0            ? std::min(affordable - capacity, 2 * capacity)
                     : affordable <= at_once ? affordable
                                             : std::min(affordable, first);
  return std::max(capacity, std::min(wanted, most));
}

bool SampleArray::grow(std::uint64_t budget_bytes) {
  constexpr std::uint64_t kEnough = std::uint64_t{1} << 20U;  // more layers than any GL has
  LayerGrowth growth;
  growth.first = kFirstLayers;
  growth.affordable = static_cast<int>(std::min(budget_bytes / bytesPerLayer(), kEnough));
  growth.at_once = whole_up_to_layers_;
  growth.most = maxLayers();
  const int layers = growth.after(capacity_);
  if (layers <= capacity_) return false;

  GLint draw_framebuffer = 0, read_framebuffer = 0;
  glGetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &draw_framebuffer);
  glGetIntegerv(GL_READ_FRAMEBUFFER_BINDING, &read_framebuffer);
  base::gl::Texture color = makeColor(layers);
  base::gl::Texture depth = makeDepth(layers);
  if (capacity_ > 0) copyLayersTo(color, depth);
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, static_cast<GLuint>(draw_framebuffer));
  glBindFramebuffer(GL_READ_FRAMEBUFFER, static_cast<GLuint>(read_framebuffer));

  color_ = std::move(color);
  depth_ = std::move(depth);
  for (int layer = layers; layer-- > capacity_;) free_.push_back(layer);
  capacity_ = layers;
  return true;
}

int SampleArray::add(const base::Image& rgba, std::uint64_t budget_bytes) {
  if (free_.empty() && !grow(budget_bytes)) return -1;
  const int layer = free_.back();
  free_.pop_back();
  glBindTexture(GL_TEXTURE_2D_ARRAY, color_.name());
  glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
  const std::vector<base::Image> levels = premultipliedPyramid(rgba);
  for (std::size_t level = 0; level < levels.size(); ++level)
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, static_cast<GLint>(level), 0, 0, layer, levels[level].width,
                    levels[level].height, 1, GL_RGBA, GL_UNSIGNED_BYTE, levels[level].pixels.data());
  return layer;
}

void SampleArray::beginDepth(int layer) const {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_.name());
  glFramebufferTextureLayer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, depth_.name(), 0, layer);
  const GLenum none = GL_NONE;
  glDrawBuffers(1, &none);
  glReadBuffer(GL_NONE);
  glViewport(0, 0, depth_width_, depth_height_);
  glClear(GL_DEPTH_BUFFER_BIT);
}

}  // namespace client
