#include "lod/draw/umbrellas.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/egl/headless.h"
#include "lod/draw/view_modes.h"
#include "tests/support/random_views.h"
#include "tests/support/umbrella_pictures.h"

namespace lod::draw {
namespace {

constexpr int kSize = 160;

using Leaves = std::vector<pmr::DrawnLeaf>;

class UmbrellasTest : public testing::Test {
 protected:
  void SetUp() override {
    auto context = base::HeadlessContext::create();
    ASSERT_TRUE(context) << context.error().message;
    context_ = std::move(*context);
    makeRenderer(100'000'000);
    auto target = base::gl::RenderTarget::create(kSize, kSize);
    ASSERT_TRUE(target);
    target_ = std::move(*target);
  }
  void TearDown() override {
    EXPECT_EQ(base::gl::takeError(), "");
    renderer_.reset();
    target_ = {};
  }
  void makeRenderer(std::uint64_t gpu_bytes) {
    auto renderer = UmbrellaRenderer::create(gpu_bytes);
    ASSERT_TRUE(renderer) << renderer.error().message;
    renderer_ = std::move(*renderer);
  }
  base::Image picture(const Leaves& leaves, const UmbrellaView& view) {
    target_.bind();
    glDepthMask(GL_TRUE);
    glClearColor(0, 0, 0, 0);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    auto drawn = renderer_->draw(leaves, view, {target_.framebuffer(), kSize, kSize});
    EXPECT_TRUE(drawn) << drawn.error().message;
    count_ = *drawn;
    return target_.read();
  }

  std::unique_ptr<base::HeadlessContext> context_;
  std::unique_ptr<UmbrellaRenderer> renderer_;
  base::gl::RenderTarget target_;
  UmbrellaCount count_;
};

const support::MadePmr& torus() {
  static const support::MadePmr made = support::madePmr(256, false);
  return made;
}

base::Camera cameraAt(double distance) {
  base::ViewCamera view;
  view.position = distance * glm::normalize(glm::dvec3(0.5, 0.2, 1.0));
  view.direction = -glm::normalize(view.position);
  view.width = view.height = kSize;
  return base::cameraForScene(view, glm::dvec3(0.0), torus().header.bounds);
}

UmbrellaView unlit(const base::Camera& camera) {
  UmbrellaView view;
  view.camera = camera;
  view.shading.unlit = true;
  view.oriented = true;
  return view;
}

/// All leaves at a level, as if a pixel had this size.
Leaves wholeTorus(std::uint32_t level, float pixel) {
  Leaves leaves;
  for (std::uint32_t leaf = 0; leaf < torus().leaves.size(); ++leaf)
    leaves.push_back({pixel, level, support::leafPicture(torus(), leaf, level)});
  return leaves;
}

/// Paints what faces the viewer red and what turns its back blue.
void paintSides(Leaves& leaves, const base::Camera& camera) {
  for (pmr::DrawnLeaf& leaf : leaves) {
    auto painted = std::make_shared<pmr::LeafPicture>(*leaf.picture);
    for (pmr::Vertex& vertex : painted->vertices) {
      const glm::vec3 normal(vertex.normal[0], vertex.normal[1], vertex.normal[2]);
      const bool faces = glm::dot(normal, camera.towardsViewer(vertex.position)) > 0.0F;
      vertex.color = faces ? glm::u8vec4(255, 0, 0, 255) : glm::u8vec4(0, 0, 255, 255);
    }
    leaf.picture = std::move(painted);
  }
}

bool isFront(const base::Image& picture, int x, int y) {
  return picture.at(x, y)[0] > 250 && picture.at(x, y)[3] == 255;
}

/// Whether the pixel and all of its neighbours show the front.
bool isWellInside(const base::Image& picture, int x, int y) {
  for (int dy = -2; dy <= 2; ++dy)
    for (int dx = -2; dx <= 2; ++dx)
      if (x + dx < 0 || x + dx >= kSize || y + dy < 0 || y + dy >= kSize || !isFront(picture, x + dx, y + dy))
        return false;
  return true;
}

/// Counts pixels within the front, as the finest triangles show it, through which something else is seen.
struct Seen {
  int front = 0, through = 0;
};
Seen compareFronts(const base::Image& truth, const base::Image& picture) {
  Seen seen;
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x) {
      if (!isWellInside(truth, x, y)) continue;
      ++seen.front;
      if (picture.at(x, y)[0] < 128) ++seen.through;
    }
  return seen;
}

TEST_F(UmbrellasTest, aClosedSurfaceShowsNothingBehindItAtAnyDistance) {
  std::uint64_t with_points = 0, with_triangles = 0;
  for (const double distance : {1.6, 2.5, 4.0, 7.0, 12.0, 20.0, 23.0, 26.0}) {
    const base::Camera camera = cameraAt(distance);
    Leaves truth = wholeTorus(0, 0.0F);
    paintSides(truth, camera);
    const base::Image all_triangles = picture(truth, unlit(camera));
    // Finer levels than the usual one have umbrellas smaller than a pixel, which are drawn as points.
    for (const float tolerance : {1.0F, 0.25F}) {
      Leaves chosen = support::chosenLeaves(torus(), camera, tolerance);
      paintSides(chosen, camera);
      const Seen seen = compareFronts(all_triangles, picture(chosen, unlit(camera)));
      EXPECT_GT(seen.front, distance < 10.0 ? 500 : 1) << distance;
      EXPECT_EQ(seen.through, 0) << distance;
      with_points += count_.points > 0 ? 1 : 0;
      with_triangles += count_.triangles > 0 ? 1 : 0;
    }
  }
  EXPECT_GE(with_points, 2U);
  EXPECT_GE(with_triangles, 2U);
}

TEST_F(UmbrellasTest, pointsAloneCloseTheSurfaceInWideAndNarrowViews) {
  support::RandomViews views(3, torus().header.bounds, kSize);
  const Leaves whole = wholeTorus(0, 0.0F);
  int checked = 0;
  for (int i = 0; i < 150; ++i) {
    const base::Camera camera = views.next();
    Leaves truth = whole;
    Leaves points = support::chosenLeaves(torus(), camera);
    for (pmr::DrawnLeaf& leaf : points) leaf.picture = whole[leaf.picture->leaf].picture;
    // The picture gets so few pixels that every umbrella lies within one.
    float widest = 0.0F;
    for (const pmr::DrawnLeaf& leaf : points)
      widest = std::max(widest, 2.0F * leaf.picture->list.point_radii.front() / leaf.pixel);
    base::Camera coarse = camera;
    const float share = std::min(1.0F, 0.999F / std::max(widest, 1e-6F));
    coarse.width = coarse.height = static_cast<int>(share * kSize);
    if (coarse.width < 24) continue;
    for (pmr::DrawnLeaf& leaf : points) leaf.pixel *= static_cast<float>(kSize) / static_cast<float>(coarse.width);
    paintSides(truth, camera);
    paintSides(points, camera);
    auto small = base::gl::RenderTarget::create(coarse.width, coarse.height);
    ASSERT_TRUE(small);
    target_ = std::move(*small);
    const auto draw = [&](const Leaves& leaves) {
      target_.bind();
      glClearColor(0, 0, 0, 0);
      glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
      auto drawn = renderer_->draw(leaves, unlit(coarse), {target_.framebuffer(), coarse.width, coarse.height});
      EXPECT_TRUE(drawn);
      count_ = *drawn;
      return target_.read();
    };
    const base::Image solid = draw(truth);
    const base::Image dots = draw(points);
    EXPECT_EQ(count_.triangles, 0U);
    for (int y = 2; y < coarse.height - 2; ++y)
      for (int x = 2; x < coarse.width - 2; ++x) {
        bool inside = true;
        for (int dy = -2; dy <= 2; ++dy)
          for (int dx = -2; dx <= 2; ++dx) inside = inside && isFront(solid, x + dx, y + dy);
        if (!inside) continue;
        ++checked;
        EXPECT_GT(dots.at(x, y)[0], 128) << "view " << i << ", pixel " << x << ", " << y;
      }
  }
  EXPECT_GT(checked, 300);
}

/// A square across the view, of small triangles between points a quarter of a pixel apart.
std::shared_ptr<pmr::LeafPicture> square(float pixel, glm::vec3 normal) {
  constexpr int kSide = 120;
  auto picture = std::make_shared<pmr::LeafPicture>();
  std::vector<glm::vec3> positions;
  normal = glm::normalize(normal);
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      pmr::Vertex vertex;
      vertex.position = glm::vec3(x - kSide / 2, y - kSide / 2, 0.0F) * (0.25F * pixel);
      for (int k = 0; k < 3; ++k)
        vertex.normal[static_cast<std::size_t>(k)] = static_cast<std::int8_t>(std::lround(127.0F * normal[k]));
      vertex.color = {200, 150, 100, 255};
      picture->vertices.push_back(vertex);
      positions.push_back(vertex.position);
    }
  std::vector<std::uint16_t> corners;
  for (int y = 0; y + 1 < kSide; ++y)
    for (int x = 0; x + 1 < kSide; ++x) {
      const auto a = static_cast<std::uint16_t>(y * kSide + x);
      const auto b = static_cast<std::uint16_t>(a + 1), c = static_cast<std::uint16_t>(a + kSide);
      for (const std::uint16_t corner : {a, b, c, b, static_cast<std::uint16_t>(c + 1), c}) corners.push_back(corner);
    }
  picture->list = pmr::makeDrawList(positions, std::vector<bool>(positions.size(), true), corners);
  return picture;
}

TEST_F(UmbrellasTest, pointsAndTrianglesAreShadedAlike) {
  base::ViewCamera at;
  at.position = {0.0, 0.0, 3.0};
  at.width = at.height = kSize;
  const base::Camera camera = base::cameraFromView(at, glm::dvec3(0.0), 0.1F, 10.0F);
  const float pixel = 1.0F / camera.pixelsPerUnit(glm::vec3(0.0F));
  for (const bool oriented : {true, false})
    for (const glm::vec3 normal : {glm::vec3(0.0F, 0.0F, 1.0F), {0.7F, 0.1F, 0.4F}, {0.2F, -0.6F, -0.5F}})
      for (const bool resolution : {false, true}) {
        const auto leaf = square(pixel, normal);
        UmbrellaView view;
        view.camera = camera;
        view.oriented = oriented;
        view.resolution_colors = resolution;
        const base::Image triangles = picture({{0.0F, 0, leaf}}, view);
        EXPECT_EQ(count_.points, 0U);
        const base::Image points = picture({{1.01F * pixel, 0, leaf}}, view);
        EXPECT_EQ(count_.triangles, 0U);
        int checked = 0;
        for (int y = 0; y < kSize; ++y)
          for (int x = 0; x < kSize; ++x) {
            if (triangles.at(x, y)[3] == 0 || points.at(x, y)[3] == 0) continue;
            ++checked;
            for (int c = 0; c < 3; ++c) EXPECT_NEAR(triangles.at(x, y)[c], points.at(x, y)[c], 2);
          }
        EXPECT_GT(checked, 700);
      }
}

TEST_F(UmbrellasTest, normalsWithoutASignAreTurnedToTheViewer) {
  base::ViewCamera at;
  at.position = {0.0, 0.0, 3.0};
  at.width = at.height = kSize;
  UmbrellaView view;
  view.camera = base::cameraFromView(at, glm::dvec3(0.0), 0.1F, 10.0F);
  const base::Image front = picture({{0.0F, 0, square(0.02F, {0.3F, 0.4F, 0.5F})}}, view);
  const base::Image back = picture({{0.0F, 0, square(0.02F, {-0.3F, -0.4F, -0.5F})}}, view);
  EXPECT_EQ(front.pixels, back.pixels);
  EXPECT_EQ(front.at(kSize / 2, kSize / 2)[3], 255);
}

TEST_F(UmbrellasTest, eachLeafDrawsThePartsOfItsLists) {
  const base::Camera camera = cameraAt(4.0);
  Leaves leaves = wholeTorus(0, 0.0F);
  picture(leaves, unlit(camera));
  EXPECT_EQ(count_.points, 0U);
  std::uint64_t triangles = 0;
  for (const pmr::DrawnLeaf& leaf : leaves) triangles += leaf.picture->list.corners.size() / 3;
  EXPECT_EQ(count_.triangles, triangles);

  std::uint64_t points = 0;
  for (pmr::DrawnLeaf& leaf : leaves) leaf.pixel = 1e9F, points += leaf.picture->list.points.size();
  picture(leaves, unlit(camera));
  EXPECT_EQ(count_.points, points);
  EXPECT_EQ(points, torus().header.points);
  EXPECT_EQ(count_.triangles, 0U);

  std::uint64_t some = 0;
  for (pmr::DrawnLeaf& leaf : leaves) {
    const auto& radii = leaf.picture->list.point_radii;
    leaf.pixel = 2.0F * radii[radii.size() / 2];
    some += leaf.picture->list.pointsAt(leaf.pixel).count();
  }
  const base::Image part = picture(leaves, unlit(camera));
  EXPECT_EQ(count_.points, some);
  EXPECT_GT(count_.triangles, 0U);
  EXPECT_LT(count_.triangles, triangles);
  for (pmr::DrawnLeaf& leaf : leaves) {
    auto sorted = std::make_shared<pmr::LeafPicture>(*leaf.picture);
    sorted->list.corners = pmr::sortedTriangles(sorted->list, sorted->vertices.size()).corners;
    leaf.picture = std::move(sorted);
  }
  EXPECT_EQ(picture(leaves, unlit(camera)).pixels, part.pixels) << "as if they had lain sorted from the beginning";
  for (pmr::DrawnLeaf& leaf : leaves) leaf.pixel = 0.0F;
  picture(leaves, unlit(camera));
  EXPECT_EQ(count_.triangles, triangles);
}

TEST_F(UmbrellasTest, aSectionCutsTrianglesAndPointsAway) {
  const base::Camera camera = cameraAt(4.0);
  for (const float pixel : {0.0F, 1e9F}) {
    UmbrellaView view = unlit(camera);
    const Leaves leaves = wholeTorus(0, pixel);
    const auto covered = [&](const glm::vec4& section) {
      view.camera.section = section;
      const base::Image drawn = picture(leaves, view);
      int pixels = 0;
      for (std::size_t i = 3; i < drawn.pixels.size(); i += 4) pixels += drawn.pixels[i] != 0 ? 1 : 0;
      return pixels;
    };
    const int whole = covered(base::kNoSection);
    const int half = covered({1.0F, 0.0F, 0.0F, 0.0F});
    EXPECT_GT(half, whole / 3);
    EXPECT_LT(half, 2 * whole / 3);
    EXPECT_EQ(covered({1.0F, 0.0F, 0.0F, -10.0F}), 0);
  }
}

TEST_F(UmbrellasTest, resolutionColorsAreThoseOfTheUmbrellasDiameterAndHatchedWhereFinerIsToCome) {
  base::ViewCamera at;
  at.position = {0.0, 0.0, 3.0};
  at.width = at.height = kSize;
  UmbrellaView view = unlit(base::cameraFromView(at, glm::dvec3(0.0), 0.1F, 10.0F));
  view.resolution_colors = true;
  const float pixel = 1.0F / view.camera.pixelsPerUnit(glm::vec3(0.0F));
  // The longest edge of each umbrella is a diagonal of √2 / 4 of `wide` pixels.
  for (const float wide : {1.0F, 2.0F, 4.0F, 8.0F, 16.0F}) {
    auto leaf = square(wide * pixel, {0.0F, 0.0F, 1.0F});
    leaf->level = 3;
    std::size_t step = 0;
    while (0.7071F * wide > kResolutionLegend[step].up_to_px) ++step;
    const auto& color = kResolutionLegend[step].color;
    const base::Image plain = picture({{0.0F, 3, leaf}}, view);
    const auto* middle = plain.at(kSize / 2, kSize / 2);
    const float brightness = static_cast<float>(middle[0]) / static_cast<float>(color[0]);
    for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(middle[c], brightness * static_cast<float>(color[c]), 3.0F) << wide;
    EXPECT_NE(picture({{0.0F, 2, leaf}}, view).pixels, plain.pixels) << "hatched";
  }
}

TEST_F(UmbrellasTest, leavesOnTheGpuAreDroppedWhenUnusedAndBeyondTheLimit) {
  const base::Camera camera = cameraAt(4.0);
  Leaves leaves = wholeTorus(0, 0.0F);
  picture(leaves, unlit(camera));
  const std::uint64_t all = renderer_->gpuBytes();
  EXPECT_GT(all, 20 * torus().header.points);
  EXPECT_EQ(all, base::gl::heldBytes().buffers);
  picture({}, unlit(camera));
  EXPECT_EQ(renderer_->gpuBytes(), all) << "they are kept for the next frame";
  leaves.resize(leaves.size() / 2);
  picture({}, unlit(camera));
  EXPECT_LT(renderer_->gpuBytes(), 2 * all / 3) << "nobody holds the others any more";
  leaves.clear();
  picture({}, unlit(camera));
  EXPECT_EQ(renderer_->gpuBytes(), 0U);

  makeRenderer(all / 4);
  leaves = wholeTorus(0, 0.0F);
  picture(leaves, unlit(camera));
  EXPECT_EQ(renderer_->gpuBytes(), all) << "a frame is drawn in any case";
  picture({leaves.front()}, unlit(camera));
  EXPECT_LE(renderer_->gpuBytes(), all / 4);
  EXPECT_GT(renderer_->gpuBytes(), 0U);
  const base::Image again = picture(leaves, unlit(camera));
  EXPECT_EQ(again.pixels, picture(leaves, unlit(camera)).pixels);
}

}  // namespace
}  // namespace lod::draw
