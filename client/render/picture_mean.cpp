#include "client/render/picture_mean.h"

#include <array>
#include <string>
#include <utility>

#include "base/check.h"
#include "client/render/shaders.h"

namespace client {
namespace {

constexpr std::uint64_t kBytesAPixel = 24;  ///< colour 4, depth 4, sums 8 each

// Sixteenths of a pixel: the Direct3D 11.3 specification, section 19.2.4.1.
constexpr std::array<glm::ivec2, 4> kFour{{{-2, -6}, {6, -2}, {-6, 2}, {2, 6}}};
constexpr std::array<glm::ivec2, 8> kEight{{{1, -3}, {-1, 3}, {5, 1}, {-3, -5}, {-5, 5}, {-7, -1}, {3, 7}, {7, -7}}};

}  // namespace

base::Result<PictureMean> PictureMean::create() {
  PictureMean mean;
  LUMIGRID_ASSIGN_OR_RETURN(mean.program_,
                            base::gl::Program::link("picture mean", glsl::kWholeVertex, glsl::kMeanFragment));
  mean.whole_ = base::gl::WholeTarget::create();
  return mean;
}

void PictureMean::release() {
  for (base::gl::Texture* texture : {&color_, &depth_, &sum_, &kept_}) *texture = {};
  picture_target_ = {}, sum_target_ = {}, kept_target_ = {};
  width_ = height_ = count_ = kept_count_ = 0;
}

base::Result<void> PictureMean::prepare(int width, int height) {
  if (width == width_ && height == height_) return {};
  release();
  color_ = base::gl::unfilteredTexture(GL_RGBA8, width, height);
  depth_ = base::gl::unfilteredTexture(GL_DEPTH_COMPONENT24, width, height);
  sum_ = base::gl::unfilteredTexture(GL_RGBA16F, width, height);
  kept_ = base::gl::unfilteredTexture(GL_RGBA16F, width, height);
  GLint bound = 0;
  glGetIntegerv(GL_FRAMEBUFFER_BINDING, &bound);
  const bool made = base::gl::attachTextures(picture_target_, {&color_}, &depth_) &&
                    base::gl::attachTextures(sum_target_, {&sum_}, nullptr) &&
                    base::gl::attachTextures(kept_target_, {&kept_}, nullptr);
  glBindFramebuffer(GL_FRAMEBUFFER, static_cast<GLuint>(bound));
  if (!made) {
    release();
    return base::Error{base::ErrorCode::kNoSpace, "means of pictures of " + std::to_string(width) + " x " +
                                                      std::to_string(height) +
                                                      " pixels: the GL refuses targets of half floats (" +
                                                      base::gl::takeError() + "); pixels have several samples instead"};
  }
  width_ = width, height_ = height;
  return {};
}

std::uint64_t PictureMean::bytesOf(int width, int height) {
  return kBytesAPixel * static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
}

glm::vec2 PictureMean::shiftOf(int i, int count) {
  LUMIGRID_CHECK(i >= 0 && i < count && count <= kMostPictures);
  const auto number = static_cast<std::size_t>(i);
  return glm::vec2(count <= 4 ? kFour.at(number) : kEight.at(number)) / 16.0F;
}

void PictureMean::beginPicture() const {
  glBindFramebuffer(GL_FRAMEBUFFER, picture_target_.name());
}

void PictureMean::addPicture() {
  LUMIGRID_CHECK(count_ < kMostPictures);
  glBindFramebuffer(GL_FRAMEBUFFER, sum_target_.name());
  if (count_++ == 0) {
    glClearColor(0.0F, 0.0F, 0.0F, 0.0F);
    glClear(GL_COLOR_BUFFER_BIT);
  }
  glEnable(GL_BLEND);
  glBlendFunc(GL_ONE, GL_ONE);
  cover(color_, 0);
  glDisable(GL_BLEND);
  glBindFramebuffer(GL_FRAMEBUFFER, picture_target_.name());
}

void PictureMean::resolveTo(GLuint framebuffer) const {
  LUMIGRID_CHECK(count_ > 0 || kept_count_ > 0);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  cover(kept_count_ > 0 ? kept_ : sum_, kept_count_ > 0 ? kept_count_ : count_);
}

void PictureMean::keep() {
  std::swap(sum_, kept_);
  std::swap(sum_target_, kept_target_);
  kept_count_ = std::exchange(count_, 0);
}

/// Draws what mean_fragment.glsl makes of a texture over the whole of the target.
void PictureMean::cover(const base::gl::Texture& picture, int count) const {
  program_.use();
  glViewport(0, 0, width_, height_);
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(GL_TEXTURE_2D, picture.name());
  glUniform1i(program_.uniform("u_picture"), 0);
  glUniform1f(program_.uniform("u_count"), static_cast<float>(count));
  glDisable(GL_DEPTH_TEST);
  whole_.draw();
  glBindTexture(GL_TEXTURE_2D, 0);
  glEnable(GL_DEPTH_TEST);
}

}  // namespace client
