// Faces that are pyramids of tiles blend as whole faces do, and where tiles meet or end no line shows.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>

#include "base/gl/gl.h"
#include "client/render/lumigraph.h"
#include "repository/sampling/cube_face.h"
#include "tests/client/render/one_context.h"
#include "tests/client/render/ray_scene.h"

namespace client {
namespace {

using testing_scene::castRays;
using testing_scene::Color;
using testing_scene::lookAt;

constexpr std::uint32_t kDepth = 2;
constexpr float kCore = static_cast<float>(repository::kTileCore) / static_cast<float>(repository::kTileSide);
const base::Sphere kScene{glm::vec3(0.0F), 8.0F};
constexpr std::uint32_t kAhead = 2;  ///< the face towards +y

/// A period of 7 pixels of the finest tiles, of which tile 0 shows nothing.
glm::vec3 fineRings(const glm::vec3& p) {
  const float wave = 0.5F + 0.4F * std::sin(220.0F * std::sqrt(p.x * p.x + p.z * p.z + 0.01F));
  return {wave, 1.0F - wave, 0.5F};
}

// A wall at y = 0, and a grid with the sampling points (0, −2, 0), in front of its middle, and (1, −2, 0).
class TiledFaces : public testing_scene::OneContext {
 protected:
  void SetUp() override {
    grid_.first = {0.0F, -2.0F, 0.0F};
    grid_.spacing = 1.0F;
    grid_.count = glm::uvec3(2);
    grid_.face_size = 256;
    grid_ = repository::withTiles(grid_, kDepth);
    options_.fade_seconds = 0.0F;
    options_.max_samples = kMaxBlended;
    options_.tuning.shade_weight = 0.0F;
    shading_.unlit = true;
    restart();
  }
  void TearDown() override {
    EXPECT_EQ(base::gl::takeError(), "");
    renderer_.reset();
  }

  /// Begins anew with the wall's proxy, which is grey, and without images.
  void restart() {
    auto made = LumigraphRenderer::create(testing_scene::kLattice, 256, std::uint64_t{256} << 20);
    ASSERT_TRUE(made) << made.error().message;
    renderer_ = std::move(made.value());
    renderer_->patches().upload(0, testing_scene::rectanglePatch(wall({}), 40, {128, 128, 128, 255}));
    next_ = 0;
  }
  static testing_scene::Rectangle wall(const Color& color) {
    return {{0, 0, 0}, {3.5F, 0, 0}, {0, 0, 3.5F}, color, {}};
  }
  static testing_scene::Scene sceneOf(const Color& color) {
    testing_scene::Scene scene;
    scene.rectangles = {wall(color)};
    return scene;
  }
  static Color constant(const glm::vec3& color) {
    return [color](const glm::vec3&) { return color; };
  }

  void addTile(const repository::TilePlace& place, const Color& color, double now = 0.0) {
    const base::Camera camera = repository::faceCamera(grid_, {0, 0, 0, kAhead, repository::tileAt(place)}, kScene);
    EXPECT_TRUE(renderer_->addSample(next_++, camera, castRays(sceneOf(color), camera), now, {.core = kCore}));
  }
  void addTiles(std::uint32_t depth, const Color& color,
                const std::function<bool(std::uint32_t x, std::uint32_t y)>& where = {}) {
    for (std::uint32_t y = 0; y < 1U << depth; ++y)
      for (std::uint32_t x = 0; x < 1U << depth; ++x)
        if (!where || where(x, y)) addTile({depth, x, y}, color);
  }
  /// Adds a plain face with as many pixels as the tiles of a depth have together.
  void addPlainFace(std::uint32_t x, std::uint32_t depth, const Color& color) {
    repository::Grid plain = grid_;
    plain.tile_depth = 0;
    plain.face_size = grid_.faceSideAt(depth);
    const base::Camera camera = repository::faceCamera(plain, {x, 0, 0, kAhead}, kScene);
    EXPECT_TRUE(renderer_->addSample(next_++, camera, castRays(sceneOf(color), camera), 0.0));
  }

  base::Image draw(const base::Camera& camera, double now = 0.0) {
    auto target = base::gl::RenderTarget::create(camera.width, camera.height);
    EXPECT_TRUE(target);
    target->bind();
    renderer_->draw(camera, cut_, {}, 0.2F, shading_, options_, now);
    return target->read();
  }
  /// The finest face, plain and as tiles.
  std::pair<base::Image, base::Image> drawPlainAndTiled(const base::Camera& camera) {
    addPlainFace(0, kDepth, fineRings);
    base::Image plain = draw(camera);
    restart();
    addTiles(kDepth, fineRings);
    return {std::move(plain), draw(camera)};
  }
  /// Returns the largest difference of two pictures, of all channels or of one.
  static int difference(const base::Image& a, const base::Image& b) {
    int largest = 0;
    for (std::size_t i = 0; i < a.pixels.size(); ++i)
      largest = std::max(largest, std::abs(int{a.pixels[i]} - int{b.pixels[i]}));
    return largest;
  }
  static double meanDifference(const base::Image& a, const base::Image& b) {
    double sum = 0.0;
    for (std::size_t i = 0; i < a.pixels.size(); ++i) sum += std::abs(int{a.pixels[i]} - int{b.pixels[i]});
    return sum / static_cast<double>(a.pixels.size());
  }
  static int largest(const base::Image& image, std::size_t channel) {
    int most = 0;
    for (std::size_t i = channel; i < image.pixels.size(); i += 4) most = std::max(most, int{image.pixels[i]});
    return most;
  }
  /// Returns the largest step of a channel from a pixel to the next one, across and down.
  static int steepest(const base::Image& image, int channel) {
    int most = 0;
    for (int y = 1; y < image.height; ++y)
      for (int x = 1; x < image.width; ++x) {
        const int here = image.at(x, y)[channel];
        most = std::max(
            {most, std::abs(here - image.at(x - 1, y)[channel]), std::abs(here - image.at(x, y - 1)[channel])});
      }
    return most;
  }

  std::unique_ptr<LumigraphRenderer> renderer_;
  repository::Grid grid_;
  LumigraphOptions options_;
  lod::draw::Shading shading_;
  SampleId next_ = 0;
  std::vector<std::uint32_t> cut_{0};
};

// Sees a bit more than the face's middle half, off its middle: the borders of all depths cross the picture.
const base::Camera kNear = lookAt({0.2F, -1.6F, 0.15F}, {0.1F, 0.0F, 0.1F}, 400, 300, 60.0F);

TEST_F(TiledFaces, theirPictureIsThatOfOneFaceWithAsManyPixels) {
  const auto [plain, tiled] = drawPlainAndTiled(kNear);
  EXPECT_LE(meanDifference(plain, tiled), 0.8) << "between texels, GL may look up to 8 bits of a place";
  EXPECT_LE(difference(plain, tiled), 8) << "at borders, too";
  restart();
  addTiles(0, fineRings);
  EXPECT_GE(meanDifference(plain, draw(kNear)), 12.0) << "so the pattern is one that tells them apart";
}

TEST_F(TiledFaces, noLineShowsWhereTheirTilesMeet) {
  // Pixels beside the tiles' borders differ from the plain face's by no more than those in the middle of tiles.
  const auto [plain, tiled] = drawPlainAndTiled(kNear);
  const glm::mat4 scene_from_clip = glm::inverse(kNear.clipFromScene());
  double sums[2] = {0.0, 0.0};
  int counts[2] = {0, 0};
  for (int y = 0; y < plain.height; ++y)
    for (int x = 0; x < plain.width; ++x) {
      const glm::vec2 ndc(2.0F * (static_cast<float>(x) + 0.5F) / 400.0F - 1.0F,
                          1.0F - 2.0F * (static_cast<float>(y) + 0.5F) / 300.0F);
      const glm::vec4 far = scene_from_clip * glm::vec4(ndc, 1.0F, 1.0F);
      const glm::vec3 ray = glm::vec3(far) / far.w - kNear.eye;
      const glm::vec3 on_wall = kNear.eye - ray * (kNear.eye.y / ray.y);
      // The wall is 2 from the sampling point, so its tiles are 1 wide.
      const float apart =
          std::min(std::abs(on_wall.x - std::round(on_wall.x)), std::abs(on_wall.z - std::round(on_wall.z)));
      const int at = apart < 0.008F ? 1 : 0;
      for (int c = 0; c < 3; ++c) sums[at] += std::abs(int{plain.at(x, y)[c]} - int{tiled.at(x, y)[c]});
      counts[at] += 3;
    }
  ASSERT_GE(counts[1], 3000);
  EXPECT_LE(sums[1] / counts[1], sums[0] / counts[0] + 0.1);
}

TEST_F(TiledFaces, coarserTilesUnderThemChangeNothing) {
  addTiles(kDepth, fineRings);
  const base::Image fine = draw(kNear);
  restart();
  addTiles(0, fineRings);
  addTiles(1, fineRings);
  addTiles(kDepth, fineRings);
  EXPECT_EQ(difference(fine, draw(kNear)), 0);
}

TEST_F(TiledFaces, aFrameDrawsDepthMapsOfAsManyTrianglesAsThreeProxies) {
  // The proxy is one patch, which each tile sees.
  options_.fade_seconds = 0.25F;
  addTiles(kDepth, constant(glm::vec3(1.0F)));
  draw(kNear);
  EXPECT_EQ(renderer_->stats().depth_maps_drawn, 3U);
  EXPECT_TRUE(renderer_->settling());

  // In 7 × 7 patches of one unit, which is a tile's width, a tile sees at most nine.
  restart();
  cut_.clear();
  for (int i = 0; i < 49; ++i) {
    testing_scene::Rectangle part = wall({});
    part.center = {static_cast<float>(i % 7) - 3.0F, 0.0F, static_cast<float>(i / 7) - 3.0F};
    part.a /= 7.0F, part.b /= 7.0F;
    cut_.push_back(static_cast<std::uint32_t>(i + 1));
    renderer_->patches().upload(cut_.back(), testing_scene::rectanglePatch(part, 4, {128, 128, 128, 255}));
  }
  addTiles(kDepth, constant(glm::vec3(1.0F)));
  draw(kNear);
  EXPECT_GE(renderer_->stats().depth_maps_drawn, 16U);
  draw(kNear, 1.0);
  EXPECT_EQ(renderer_->stats().depth_maps_drawn, 0U);
}

// The tiles of one point are green; the other point's face is red. Where tiles lose weight, red comes through.
class TilesBesideAFace : public TiledFaces {
 protected:
  const Color green_ = constant({0.0F, 0.8F, 0.0F});
  const Color red_ = constant({0.8F, 0.0F, 0.0F});
  // Four times the pixels of tile 0, so that a finer tile has far more weight.
  const base::Camera camera_ = lookAt({0.3F, -1.7F, 0.1F}, {0.2F, 0.0F, 0.1F}, 800, 600, 60.0F);
  void addOther() { addPlainFace(1, 1, red_); }
};

TEST_F(TilesBesideAFace, aFineTileOverACoarseOneHasNoFrame) {
  addOther();
  addTiles(0, green_);
  const base::Image coarse = draw(camera_);
  EXPECT_GE(largest(coarse, 0), 100) << "the other point's face has its share";
  addTile({2, 1, 1}, green_);
  addTile({2, 2, 1}, green_);
  const base::Image both = draw(camera_);
  EXPECT_GE(difference(coarse, both), 60);
  for (std::size_t i = 0; i < both.pixels.size(); i += 4)
    ASSERT_LE(int{both.pixels[i]}, int{coarse.pixels[i]} + 2) << "pixel " << i / 4 % 800 << " " << i / 4 / 800;
  EXPECT_LE(steepest(both, 0), 20) << "it fades into the coarse one";
}

TEST_F(TilesBesideAFace, tilesOfTwoDepthsSideBySideHaveNoGap) {
  addOther();
  addTiles(1, green_);
  const base::Image coarse = draw(camera_);
  restart();
  addOther();
  addTiles(1, green_, [](std::uint32_t x, std::uint32_t) { return x == 0; });
  addTiles(2, green_, [](std::uint32_t x, std::uint32_t) { return x >= 2; });
  const base::Image both = draw(camera_);
  EXPECT_GE(difference(coarse, both), 20) << "finer tiles have more weight";
  for (std::size_t i = 0; i < both.pixels.size(); i += 4)
    ASSERT_LE(int{both.pixels[i]}, int{coarse.pixels[i]} + 2) << "pixel " << i / 4 % 800 << " " << i / 4 / 800;
  EXPECT_LE(steepest(both, 0), 20);
}

TEST_F(TilesBesideAFace, aFineTileFadesInWithoutAJump) {
  options_.fade_seconds = 0.25F;
  const Color blue = constant({0.0F, 0.0F, 0.8F});
  const base::Camera camera = lookAt({0.3F, -1.7F, 0.1F}, {0.2F, 0.0F, 0.1F}, 200, 150, 60.0F);
  addOther();
  addTiles(0, green_);
  base::Image before;
  for (int i = 0; i < 30; ++i) before = draw(camera, 1.0 + 0.05 * i);
  EXPECT_FALSE(renderer_->settling());
  const base::Image first = before;
  addTile({2, 2, 1}, blue, 5.0);
  int step = 0;
  for (int i = 0; i < 60; ++i) {
    const base::Image now = draw(camera, 5.0 + i / 60.0);
    step = std::max(step, difference(before, now));
    before = now;
  }
  EXPECT_GE(difference(first, before), 100);
  EXPECT_LE(step, 60);
}

}  // namespace
}  // namespace client
