#pragma once
// A lumigraph of balls and rectangles, whose images are cast by rays.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "base/gl/gl.h"
#include "base/gl/multisampled_target.h"
#include "base/png/png.h"
#include "client/render/lumigraph.h"
#include "tests/client/render/one_context.h"
#include "tests/client/render/ray_scene.h"

namespace testing_scene {

using client::LumigraphOptions;
using client::LumigraphRenderer;
using client::SampleId;

inline constexpr int kFace = 160;
inline constexpr std::uint64_t kBudget = std::uint64_t{256} << 20;
const glm::u8vec4 kWhite{255, 255, 255, 255};
const glm::vec3 kEye{0.0F, -3.0F, 0.0F};

/// The pattern is so smooth that a face of 160 pixels resolves it.
inline glm::vec3 pattern(const glm::vec3& p) {
  return {0.5F + 0.4F * std::sin(3.0F * p.x + 1.0F), 0.5F + 0.4F * std::sin(4.0F * p.z),
          0.5F + 0.3F * std::sin(2.0F * p.y + 3.0F * p.x)};
}

class Lumigraph : public OneContext {
 protected:
  void SetUp() override {
    options_.fade_seconds = 0.0F;
    // The proxies have colours unlike the images', so that only images may show; tests that shade set the weight again.
    options_.tuning.shade_weight = 0.0F;
    shading_.unlit = true;
    renderer_ = make(kBudget);
  }
  void TearDown() override {
    EXPECT_EQ(base::gl::takeError(), "");
    renderer_.reset();
  }

  static std::unique_ptr<LumigraphRenderer> make(std::uint64_t budget) {
    auto made = LumigraphRenderer::create(kLattice, kFace, budget);
    EXPECT_TRUE(made) << made.error().message;
    return std::move(made.value());
  }

  void addPatch(const lod::patch::PatchGeometry& patch) {
    renderer_->patches().upload(static_cast<std::uint32_t>(cut_.size()), patch);
    cut_.push_back(static_cast<std::uint32_t>(cut_.size()));
  }
  void addCube(const glm::vec3& eye, SampleId first) {
    for (const base::Camera& camera : cubeCameras(eye, kFace))
      EXPECT_TRUE(renderer_->addSample(first++, camera, castRays(scene_, camera), 0.0));
  }
  void addImage(SampleId id, const base::Camera& camera) {
    EXPECT_TRUE(renderer_->addSample(id, camera, castRays(scene_, camera), 0.0));
  }

  static glm::ivec4 pixel(const base::Image& image, int x, int y) {
    const std::uint8_t* p = image.at(x, y);
    return {p[0], p[1], p[2], p[3]};
  }
  static glm::ivec4 opaque(const std::array<std::uint8_t, 3>& color) { return {color[0], color[1], color[2], 255}; }

  base::Image draw(const base::Camera& camera, double now = 0.0, float cut_error_px = 0.2F) {
    auto target = base::gl::RenderTarget::create(camera.width, camera.height);
    EXPECT_TRUE(target);
    target->bind();
    renderer_->draw(camera, cut_, {}, cut_error_px, shading_, options_, now, occluders_, errors_px_, proxy_errors_);
    base::Image image = target->read();
    keepPicture(image);
    return image;
  }
  void keepPicture(const base::Image& image) {
    const char* folder = std::getenv("LUMIGRID_TEST_PICTURES");
    if (folder == nullptr) return;
    const std::string name = ::testing::UnitTest::GetInstance()->current_test_info()->name();
    EXPECT_TRUE(base::writePng(image, std::string(folder) + "/" + name + "_" + std::to_string(pictures_++) + ".png"));
  }

  /// Draws four samples a pixel, whose means are premultiplied.
  base::Image drawMultisampled(const base::Camera& camera, float cut_error_px = 0.2F) {
    auto target = base::gl::RenderTarget::create(camera.width, camera.height);
    const auto samples = base::gl::MultisampledTarget::create(camera.width, camera.height, 4);
    EXPECT_TRUE(target && samples);
    samples->bind();
    options_.multisampled = true;
    renderer_->draw(camera, cut_, {}, cut_error_px, shading_, options_, 0.0);
    samples->resolveTo(target->framebuffer(), camera.width, camera.height);
    base::Image image = target->read();
    keepPicture(image);
    return image;
  }

  /// Makes a ball of radius 1 with the pattern, and its proxy.
  void makeBall(float proxy_radius = 1.0F, int rings = 60) {
    scene_.balls = {{glm::vec3(0.0F), 1.0F, pattern}};
    addPatch(ballPatch(glm::vec3(0.0F), proxy_radius, rings, kWhite));
  }

  std::unique_ptr<LumigraphRenderer> renderer_;
  Scene scene_;
  std::vector<std::uint32_t> cut_, occluders_;
  std::vector<float> errors_px_;
  std::vector<client::ProxyError> proxy_errors_;
  LumigraphOptions options_;
  lod::draw::Shading shading_;
  int pictures_ = 0;
};

}  // namespace testing_scene
