#include "server/render/scene_renderer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <random>
#include <thread>
#include <tuple>

#include "base/egl/headless.h"
#include "base/gl/gl.h"
#include "lod/draw/triangles.h"
#include "lod/patch/codec.h"
#include "tests/server/render/two_level_scene.h"

namespace server {
namespace {

using test::Triangle;
using test::TwoLevelScene;

// This is the colour as patches store it.
const glm::u8vec4 kOrange = lod::patch::quantizedColor({200, 100, 50, 255});

// Returns a camera at (0, 0, distance) that looks along −z with 90°: the plane z = 0 shows [−distance, distance].
base::Camera cameraAt(float distance, int size) {
  base::ViewCamera view;
  view.position = {0, 0, distance};
  view.fov_y = glm::radians(90.0);
  view.width = size;
  view.height = size;
  return base::cameraFromView(view, glm::dvec3(0.0), 0.25F, 100.0F);
}

// Returns the six 90° cameras around a point.
std::vector<base::Camera> facesAt(const glm::dvec3& eye, int size) {
  const glm::dvec3 axes[] = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
  std::vector<base::Camera> cameras;
  for (const glm::dvec3& axis : axes) {
    base::ViewCamera view;
    view.position = eye;
    view.direction = axis;
    view.up = axis.z == 0.0 ? glm::dvec3(0, 0, 1) : glm::dvec3(0, 1, 0);
    view.fov_y = glm::radians(90.0);
    view.width = size;
    view.height = size;
    cameras.push_back(base::cameraFromView(view, glm::dvec3(0.0), 0.05F, 100.0F));
  }
  return cameras;
}

// Returns random small triangles all over a box of ±4, the same each time: `count` in each of `leaves` leaves.
std::vector<std::vector<Triangle>> confetti(int leaves, int count) {
  std::mt19937 random(7);
  const auto number = [&](float low, float high) {
    return low + (high - low) * static_cast<float>(random()) / static_cast<float>(std::mt19937::max());
  };
  std::vector<std::vector<Triangle>> all(static_cast<std::size_t>(leaves));
  for (auto& leaf : all)
    for (int i = 0; i < count; ++i) {
      const glm::vec3 center(number(-4, 4), number(-4, 4), number(-4, 4));
      const auto corner = [&] { return center + glm::vec3(number(-1, 1), number(-1, 1), number(-1, 1)); };
      const auto shade = [&] { return static_cast<std::uint8_t>(number(0, 255)); };
      leaf.push_back({corner(), corner(), corner(), {shade(), shade(), shade(), 255}});
    }
  return all;
}

class SceneRendererTest : public testing::Test {
 protected:
  void SetUp() override {
    auto context = base::HeadlessContext::create();
    ASSERT_TRUE(context) << context.error().message;
    context_ = std::move(*context);
  }
  void TearDown() override { EXPECT_EQ(base::gl::takeError(), ""); }

  static std::unique_ptr<SceneRenderer> rendererOf(TwoLevelScene& scene,
                                                   std::uint64_t budget = std::uint64_t{1} << 30) {
    auto renderer = SceneRenderer::create(scene.scene(), scene.file(), budget);
    if (!renderer) {
      ADD_FAILURE() << renderer.error().message;
      return nullptr;
    }
    return std::move(*renderer);
  }
  static RenderedPicture draw(SceneRenderer& renderer, const base::Camera& camera, const RenderOptions& options) {
    auto rendered = renderer.render(camera, options);
    if (!rendered) {
      ADD_FAILURE() << rendered.error().message;
      return {};
    }
    return std::move(*rendered);
  }

  std::unique_ptr<base::HeadlessContext> context_;
};

// ---- Coverage and colour ----

// On 8 × 8 pixels that show [−8, 8]² a triangle whose edges miss all sample positions:
//   (−7.25, −6.5), (6.75, −5.5), (−2.25, 7.5)
const Triangle kKnown{{-7.25F, -6.5F, 0}, {6.75F, -5.5F, 0}, {-2.25F, 7.5F, 0}, kOrange};

bool insideKnown(double x, double y) {
  const auto side = [&](const glm::vec3& a, const glm::vec3& b) {
    return (double{b.x} - double{a.x}) * (y - double{a.y}) - (double{b.y} - double{a.y}) * (x - double{a.x});
  };
  return side(kKnown.a, kKnown.b) > 0 && side(kKnown.b, kKnown.c) > 0 && side(kKnown.c, kKnown.a) > 0;
}

// Counts the pixel's samples that lie in the triangle; pixel rows count from the top.
int samplesInside(int px, int py, int n) {
  int inside = 0;
  for (int sy = 0; sy < n; ++sy)
    for (int sx = 0; sx < n; ++sx) {
      const double x = -8.0 + 2.0 * (px + (sx + 0.5) / n);
      const double y = 8.0 - 2.0 * (py + (sy + 0.5) / n);
      if (insideKnown(x, y)) ++inside;
    }
  return inside;
}

TEST_F(SceneRendererTest, alphaIsExactlyTheShareOfSamplesInsideTheTriangle) {
  TwoLevelScene scene({kKnown}, {{kKnown}}, 0.1F);
  auto renderer = rendererOf(scene);
  for (const int n : {1, 2, 4}) {
    const RenderedPicture rendered = draw(*renderer, cameraAt(8, 8), {0.0F, n});
    int partly = 0;
    for (int y = 0; y < 8; ++y)
      for (int x = 0; x < 8; ++x) {
        const int inside = samplesInside(x, y, n);
        const double expected = 255.0 * inside / (n * n);  // which GL may round either way
        EXPECT_NEAR(rendered.rgba.at(x, y)[3], expected, 0.51) << "pixel " << x << ", " << y << " with " << n << "²";
        if (inside > 0 && inside < n * n) ++partly;
      }
    EXPECT_EQ(partly > 0, n > 1);
  }
}

TEST_F(SceneRendererTest, edgePixelsHaveTheModelsColourAndOthersAreTransparentBlack) {
  TwoLevelScene scene({kKnown}, {{kKnown}}, 0.1F);
  auto renderer = rendererOf(scene);
  const RenderedPicture rendered = draw(*renderer, cameraAt(8, 8), {0.0F, 4});
  for (int y = 0; y < 8; ++y)
    for (int x = 0; x < 8; ++x) {
      const std::uint8_t* p = rendered.rgba.at(x, y);
      const glm::u8vec4 expected = p[3] > 0 ? kOrange : glm::u8vec4(0);
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(p[c], expected[c], 1) << x << ", " << y;
    }
}

TEST_F(SceneRendererTest, trianglesAreSeenFromBehindToo) {
  const Triangle turned{kKnown.a, kKnown.c, kKnown.b, kOrange};
  TwoLevelScene front({kKnown}, {{kKnown}}, 0.1F);
  const RenderedPicture expected = draw(*rendererOf(front), cameraAt(8, 8), {0.0F, 1});
  TwoLevelScene back({turned}, {{turned}}, 0.1F);
  const RenderedPicture rendered = draw(*rendererOf(back), cameraAt(8, 8), {0.0F, 1});
  EXPECT_EQ(rendered.rgba.pixels, expected.rgba.pixels);
}

TEST_F(SceneRendererTest, nearerSurfaceHidesTheFartherWhateverTheOrder) {
  const Triangle near_one{{-4, -4, 1}, {4, -4, 1}, {0, 4, 1}, {255, 0, 0, 255}};
  const Triangle far_one{{-4, -4, 0}, {4, -4, 0}, {0, 4, 0}, {0, 255, 0, 255}};
  for (const bool near_first : {true, false}) {
    const auto leaves = near_first ? std::vector<std::vector<Triangle>>{{near_one}, {far_one}}
                                   : std::vector<std::vector<Triangle>>{{far_one}, {near_one}};
    TwoLevelScene scene({near_one}, leaves, 0.1F);
    const RenderedPicture rendered = draw(*rendererOf(scene), cameraAt(8, 9), {0.0F, 1});
    EXPECT_EQ(rendered.rgba.at(4, 4)[0], 255);
    EXPECT_EQ(rendered.rgba.at(4, 4)[1], 0);
  }
}

/// A square sheet of ±20 units that rises along x, as so many leaves along each side, a step of the lattice lower if
/// `is_lower`.
void addSheet(std::vector<std::vector<Triangle>>& leaves, int parts, bool is_lower, const glm::u8vec4& color) {
  const float size = 40.0F / static_cast<float>(parts);
  for (int part = 0; part < parts * parts; ++part) {
    const auto corner = [&](int x, int y) {
      const glm::vec2 at = size * glm::vec2(part % parts + x, part / parts + y) - 20.0F;
      return glm::vec3(at, 0.25F * at.x - (is_lower ? 1.0F / 64.0F : 0.0F));
    };
    leaves.push_back(
        {{corner(0, 0), corner(1, 0), corner(0, 1), color}, {corner(1, 0), corner(1, 1), corner(0, 1), color}});
  }
}

// The sheets are 4 mm apart where the scene has 10 m. The eye is within the scene's sphere, and with one leaf a sheet
// within its box.
TEST_F(SceneRendererTest, aSheetHidesTheOneCloseBehindIt) {
  for (const int parts : {8, 1}) {
    std::vector<std::vector<Triangle>> leaves;
    addSheet(leaves, parts, true, {40, 60, 200, 255});
    addSheet(leaves, parts, false, {200, 60, 40, 255});
    TwoLevelScene scene({kKnown}, leaves, 0.1F);
    auto renderer = rendererOf(scene);
    for (const double away : {8.0, 16.8, 24.0, 27.0}) {
      base::ViewCamera view;
      view.direction = glm::normalize(glm::dvec3(-0.1, 0.2, -1.0));
      view.position = -away * view.direction;
      view.width = view.height = 200;
      const RenderedPicture rendered =
          draw(*renderer, base::cameraForScene(view, glm::dvec3(0.0), {glm::vec3(0.0F), 29.0F}), {0.0F, 1});
      int hidden = 0, seen = 0;
      for (int y = 0; y < 200; ++y)
        for (int x = 0; x < 200; ++x) {
          const auto* pixel = rendered.rgba.at(x, y);
          ++(pixel[2] > pixel[0] ? hidden : seen);
        }
      EXPECT_EQ(hidden, 0) << parts << " leaves a side from " << away;
      EXPECT_GT(seen, 20000);
    }
  }
}

TEST_F(SceneRendererTest, softLightDarkensWhatTurnsAwayAndUnlitDoesNot) {
  // Faces +z; the light comes from the side.
  TwoLevelScene scene({kKnown}, {{kKnown}}, 0.1F);
  scene.scene().light.direction = {1, 0, 0};
  const RenderedPicture unlit = draw(*rendererOf(scene), cameraAt(8, 8), {0.0F, 1});
  scene.scene().light.mode = base::LightMode::kSoft;
  const RenderedPicture soft = draw(*rendererOf(scene), cameraAt(8, 8), {0.0F, 1});
  EXPECT_EQ(unlit.rgba.at(3, 4)[0], kOrange.r);
  EXPECT_NEAR(soft.rgba.at(3, 4)[0], kOrange.r * (0.15 + 0.85 * 0.25), 1.5);
  EXPECT_EQ(soft.rgba.at(3, 4)[3], 255);
}

// A vertex at a cube's edge has one normal for all sides. Those that lean from the eye were turned over, and lit from
// behind.
TEST_F(SceneRendererTest, normalsFarFromTheirTriangleGiveWayToItsOwn) {
  const auto redWith = [](const glm::vec3& normal, const glm::vec3& light, bool own_light) {
    Triangle triangle = kKnown;
    triangle.normal = normal;
    TwoLevelScene scene({triangle}, {{triangle}}, 0.1F);
    scene.scene().light.mode = base::LightMode::kSoft;
    scene.scene().light.direction = light;
    RenderOptions options{0.0F, 1};
    if (own_light) options.modes.light = light;
    return int{draw(*rendererOf(scene), cameraAt(8, 8), options).rgba.at(3, 4)[0]};
  };
  for (const bool own_light : {false, true}) {
    const glm::vec3 light(0.8F, 0, 0.6F);
    const int flat = redWith({0, 0, 1}, light, own_light);
    // By 53 degrees to either side, by 100, and inwards, as some meshes have all of theirs.
    for (const glm::vec3 leaning :
         {glm::vec3(0.8F, 0, 0.6F), {-0.8F, 0, 0.6F}, {-0.98F, 0, -0.17F}, {0.98F, 0, -0.17F}, {0, 0, -1}})
      EXPECT_NEAR(redWith(leaning, light, own_light), flat, 1) << leaning.x << " " << leaning.z;
    // One that leans a little is seen as it is.
    EXPECT_GT(redWith({0.3F, 0, 0.954F}, light, own_light), flat + 10);
    EXPECT_LT(redWith({-0.3F, 0, 0.954F}, light, own_light), flat - 10);
  }
}

TEST_F(SceneRendererTest, aLightOfTheViewersOwnShadesColoursInPlaceOfTheScenes) {
  // Faces +z.
  TwoLevelScene scene({kKnown}, {{kKnown}}, 0.1F);
  const auto redIn = [&](const glm::vec3& light) {
    RenderOptions options{0.0F, 1};
    options.modes.light = light;
    return int{draw(*rendererOf(scene), cameraAt(8, 8), options).rgba.at(3, 4)[0]};
  };
  for (const base::LightMode mode : {base::LightMode::kUnlit, base::LightMode::kSoft}) {
    scene.scene().light.mode = mode;
    EXPECT_NEAR(redIn({0, 0, 1}), kOrange.r, 1.5);
    EXPECT_NEAR(redIn({0.6F, 0, 0.8F}), kOrange.r * (0.2 + 0.8 * 0.8), 1.5);
    EXPECT_NEAR(redIn({1, 0, 0}), kOrange.r * 0.2, 1.5);
    EXPECT_NEAR(redIn({0, 0, -1}), kOrange.r * 0.2, 1.5);
  }
}

// ---- Choosing the cut ----

// The root shows one orange triangle, the leaves two white ones. An error of 0.5 at distance 8 is about 0.5 pixels of 2
// units a pixel at 8 pixels, 4 of them at 64.
TEST_F(SceneRendererTest, toleranceInPixelsChoosesBetweenRootAndLeaves) {
  const Triangle left{{-4, -4, 0}, {0, -4, 0}, {0, 4, 0}};
  const Triangle right{{0, -4, 0}, {4, -4, 0}, {0, 4, 0}};
  TwoLevelScene scene({{{-4, -4, 0}, {4, -4, 0}, {0, 4, 0}, kOrange}}, {{left}, {right}}, 0.5F);
  auto renderer = rendererOf(scene);
  EXPECT_EQ(draw(*renderer, cameraAt(8, 64), {100.0F, 1}).triangles, 1U);
  EXPECT_EQ(draw(*renderer, cameraAt(8, 64), {0.1F, 1}).triangles, 2U);
  EXPECT_EQ(draw(*renderer, cameraAt(8, 64), {0.0F, 1}).triangles, 2U);
}

TEST_F(SceneRendererTest, refinementEndsAtTheLimitOfTriangles) {
  const Triangle left{{-4, -4, 0}, {0, -4, 0}, {0, 4, 0}};
  const Triangle right{{0, -4, 0}, {4, -4, 0}, {0, 4, 0}};
  TwoLevelScene scene({{{-4, -4, 0}, {4, -4, 0}, {0, 4, 0}, kOrange}}, {{left}, {right}}, 0.5F);
  auto renderer = rendererOf(scene);
  EXPECT_EQ(draw(*renderer, cameraAt(8, 64), {.tolerance_px = 0.0F, .max_triangles = 1}).triangles, 1U);
  EXPECT_EQ(draw(*renderer, cameraAt(8, 64), {.tolerance_px = 0.0F, .max_triangles = 2}).triangles, 2U);
}

TEST(ExactFrameOptions, leavesWithAsManySamplesAsLargePicturesAllow) {
  for (const auto& [width, height, samples] :
       {std::tuple{1, 1, 4}, {1280, 720, 4}, {1920, 1080, 4}, {2560, 1440, 3}, {3840, 2160, 2}, {16384, 976, 2}}) {
    const RenderOptions options = exactFrameOptions(width, height);
    EXPECT_EQ(options.supersampling, samples) << width << " x " << height;
    EXPECT_EQ(options.tolerance_px, 0.0F);
    EXPECT_EQ(options.max_triangles, base::ViewDefaults::kFrameTriangles);
  }
}

TEST_F(SceneRendererTest, supersamplingDoesNotChangeTheCut) {
  const Triangle left{{-4, -4, 0}, {0, -4, 0}, {0, 4, 0}};
  const Triangle right{{0, -4, 0}, {4, -4, 0}, {0, 4, 0}};
  TwoLevelScene scene({{{-4, -4, 0}, {4, -4, 0}, {0, 4, 0}, kOrange}}, {{left}, {right}}, 0.5F);
  auto renderer = rendererOf(scene);
  const auto error_px = 0.5F * cameraAt(8, 64).pixelsPerUnitAtOne();  // at distance 1, more than it ever is here
  for (float tolerance = error_px / 64.0F; tolerance < error_px; tolerance *= 1.5F)
    EXPECT_EQ(draw(*renderer, cameraAt(8, 64), {tolerance, 1}).triangles,
              draw(*renderer, cameraAt(8, 64), {tolerance, 8}).triangles);
}

TEST_F(SceneRendererTest, parallelViewUsesOneWorldError) {
  TwoLevelScene scene({kKnown}, {{kKnown, kKnown}}, 0.5F);
  auto renderer = rendererOf(scene);
  base::Camera camera = cameraAt(8, 16);
  camera.clip_from_eye = glm::ortho(-8.0F, 8.0F, -8.0F, 8.0F, 0.25F, 100.0F);  // one pixel a unit
  EXPECT_EQ(draw(*renderer, camera, {0.6F, 1}).triangles, 1U);
  const RenderedPicture fine = draw(*renderer, camera, {0.4F, 1});
  EXPECT_EQ(fine.triangles, 2U);
  EXPECT_EQ(fine.rgba.at(7, 8)[3], 255);
}

// ---- Tiles ----

TEST_F(SceneRendererTest, tiledPictureEqualsTheWholeOne) {
  const auto leaves = confetti(8, 40);
  TwoLevelScene scene({kKnown}, leaves, 0.5F);
  auto renderer = rendererOf(scene);
  for (const int n : {1, 2}) {
    const RenderedPicture whole = draw(*renderer, cameraAt(9, 96), {0.0F, n});
    RenderOptions by_limit{0.0F, n}, by_wish{0.0F, n};
    by_limit.max_target_samples = 40 * 40;  // tiles that do not divide the picture
    by_wish.tile_samples = 40 * 40;
    const RenderedPicture tiled = draw(*renderer, cameraAt(9, 96), by_limit);
    EXPECT_EQ(tiled.triangles, whole.triangles);
    EXPECT_EQ(draw(*renderer, cameraAt(9, 96), by_wish).rgba.pixels, tiled.rgba.pixels) << n;

    // An edge may fall to the other side of a sample by float rounding, in few pixels.
    int outliers = 0;
    for (std::size_t i = 0; i < whole.rgba.pixels.size(); ++i)
      if (std::abs(int{whole.rgba.pixels[i]} - int{tiled.rgba.pixels[i]}) > 1) ++outliers;
    EXPECT_LE(outliers, 96 * 96 * 4 / 1000) << n;
  }
}

TEST_F(SceneRendererTest, tileWithNothingInItStaysTransparent) {
  const Triangle corner{{-7, 5, 0}, {-5, 5, 0}, {-6, 7, 0}, kOrange};
  TwoLevelScene scene({corner}, {{corner}}, 0.1F);
  auto renderer = rendererOf(scene);
  RenderOptions small{0.0F, 1};
  small.max_target_samples = 16 * 16;
  const RenderedPicture tiled = draw(*renderer, cameraAt(8, 32), small);
  EXPECT_EQ(tiled.rgba.pixels, draw(*renderer, cameraAt(8, 32), {0.0F, 1}).rgba.pixels);
  EXPECT_EQ(std::count(tiled.rgba.pixels.begin(), tiled.rgba.pixels.end(), kOrange.r) > 0, true);
}

// ---- Budget ----

TEST_F(SceneRendererTest, pictureDoesNotDependOnTheBudget) {
  const auto leaves = confetti(12, 30);
  TwoLevelScene scene({kKnown}, leaves, 0.5F);
  const std::vector<std::uint8_t> expected = draw(*rendererOf(scene), cameraAt(9, 64), {0.0F, 2}).rgba.pixels;
  const std::uint64_t patch_bytes = lod::draw::PatchMeshes::bytesFor(90, 30);
  for (const std::uint64_t patches : {0, 1, 3, 7}) {
    auto renderer = rendererOf(scene, patches * patch_bytes);
    for (int round = 0; round < 2; ++round)
      EXPECT_EQ(draw(*renderer, cameraAt(9, 64), {0.0F, 2}).rgba.pixels, expected) << patches << " patches";
  }
}

// ---- Several cameras ----

TEST_F(SceneRendererTest, renderManyEqualsRenderForEachFaceInOrder) {
  const auto leaves = confetti(8, 40);
  TwoLevelScene scene({kKnown}, leaves, 0.5F);
  auto renderer = rendererOf(scene);
  for (const int n : {1, 2}) {
    const std::vector<base::Camera> cameras = facesAt({0.3, -0.2, 0.1}, 48);
    std::vector<std::size_t> order;
    std::vector<RenderedPicture> many(6);
    ASSERT_TRUE(renderer->renderMany(cameras, {0.0F, n}, [&](std::size_t i, RenderedPicture rendered) {
      order.push_back(i);
      many[i] = std::move(rendered);
    }));
    ASSERT_TRUE(renderer->finish());
    EXPECT_EQ(order, (std::vector<std::size_t>{0, 1, 2, 3, 4, 5}));
    for (std::size_t i = 0; i < 6; ++i) {
      const RenderedPicture one = draw(*renderer, cameras[i], {0.0F, n});
      EXPECT_EQ(many[i].rgba.pixels, one.rgba.pixels) << "face " << i;
      EXPECT_EQ(many[i].triangles, one.triangles);
      EXPECT_GT(one.triangles, 0U);
    }
  }
}

TEST_F(SceneRendererTest, faceThatSeesNothingHasNoPixelsAndKeepsItsPlace) {
  TwoLevelScene scene({kKnown}, {{kKnown}}, 0.1F);
  auto renderer = rendererOf(scene);
  std::vector<std::size_t> order;
  std::vector<RenderedPicture> many(6);
  const auto take = [&](std::size_t i, RenderedPicture rendered) {
    order.push_back(i);
    many[i] = std::move(rendered);
  };
  // Far on the +z side: only face 5, −z, sees the model.
  ASSERT_TRUE(renderer->renderMany(facesAt({0, 0, 20}, 16), {0.0F, 1}, take));
  ASSERT_TRUE(renderer->finish());
  EXPECT_EQ(order, (std::vector<std::size_t>{0, 1, 2, 3, 4, 5}));
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_TRUE(many[i].rgba.empty()) << "face " << i;
    EXPECT_EQ(many[i].triangles, 0U);
  }
  EXPECT_EQ(draw(*renderer, facesAt({0, 0, 20}, 16)[0], {0.0F, 1}).rgba.pixels,
            std::vector<std::uint8_t>(16 * 16 * 4, 0));
  EXPECT_NE(many[5].rgba.pixels, std::vector<std::uint8_t>(16 * 16 * 4, 0));
}

TEST_F(SceneRendererTest, picturesOfSeveralCallsArriveOnceEachInOrder) {
  const auto leaves = confetti(2, 40);
  TwoLevelScene scene({kKnown}, leaves, 0.5F);
  auto renderer = rendererOf(scene);
  std::vector<std::size_t> order;
  for (std::size_t call = 0; call < 4; ++call)
    ASSERT_TRUE(
        renderer->renderMany(facesAt({0, 0, 0.1}, 16), {1.0F, 1},
                             [&order, call](std::size_t i, RenderedPicture) { order.push_back(call * 6 + i); }));
  EXPECT_LT(order.size(), 24U) << "the last pictures are still on their way";
  EXPECT_GT(order.size(), 12U);
  ASSERT_TRUE(renderer->finish());
  std::vector<std::size_t> expected(24);
  for (std::size_t i = 0; i < 24; ++i) expected[i] = i;
  EXPECT_EQ(order, expected);
}

TEST_F(SceneRendererTest, cutForSeveralCamerasIsThatOfTheFinest) {
  const Triangle left{{-4, -4, 0}, {0, -4, 0}, {0, 4, 0}};
  const Triangle right{{0, -4, 0}, {4, -4, 0}, {0, 4, 0}};
  TwoLevelScene scene({{{-4, -4, 0}, {4, -4, 0}, {0, 4, 0}, kOrange}}, {{left}, {right}}, 0.5F);
  auto renderer = rendererOf(scene);
  // Alone the small one would take the root; beside the large one it shows the leaves as well.
  const std::vector<base::Camera> cameras{cameraAt(8, 4), cameraAt(8, 256)};
  EXPECT_EQ(draw(*renderer, cameras[0], {2.0F, 1}).triangles, 1U);
  std::vector<std::uint64_t> triangles;
  ASSERT_TRUE(renderer->renderMany(cameras, {2.0F, 1}, [&](std::size_t, const RenderedPicture& rendered) {
    triangles.push_back(rendered.triangles);
  }));
  ASSERT_TRUE(renderer->finish());
  EXPECT_EQ(triangles, (std::vector<std::uint64_t>{2, 2}));
}

// ---- Threads and errors ----

TEST_F(SceneRendererTest, twoRenderersOnTwoThreadsDrawTheSame) {
  const auto leaves = confetti(6, 40);
  TwoLevelScene scene({kKnown}, leaves, 0.5F);
  const std::vector<std::uint8_t> expected = draw(*rendererOf(scene), cameraAt(9, 64), {0.0F, 2}).rgba.pixels;
  std::vector<int> good(2, 0);
  const auto work = [&](std::size_t which) {
    auto context = base::HeadlessContext::create();
    if (!context) return;
    auto renderer = SceneRenderer::create(scene.scene(), scene.file(), 1 << 14);
    if (!renderer) return;
    for (int i = 0; i < 8; ++i) {
      auto rendered = (*renderer)->render(cameraAt(9, 64), {0.0F, 2});
      if (rendered && rendered->rgba.pixels == expected) ++good[which];
    }
  };
  std::thread first(work, 0);
  std::thread second(work, 1);
  first.join();
  second.join();
  EXPECT_EQ(good[0], 8);
  EXPECT_EQ(good[1], 8);
}

TEST_F(SceneRendererTest, sizeAndSupersamplingOutOfRangeAreErrors) {
  TwoLevelScene scene({kKnown}, {{kKnown}}, 0.1F);
  auto renderer = rendererOf(scene);
  base::Camera camera = cameraAt(8, 8);
  EXPECT_FALSE(renderer->render(camera, {1.0F, 0}));
  EXPECT_FALSE(renderer->render(camera, {1.0F, 9}));
  EXPECT_FALSE(renderer->render(camera, {-1.0F, 1}));
  EXPECT_FALSE(renderer->render(camera, {std::nanf(""), 1}));
  camera.width = 0;
  EXPECT_FALSE(renderer->render(camera, {1.0F, 1}));
  camera.width = 1 << 20;
  const auto huge = renderer->render(camera, {1.0F, 1});
  ASSERT_FALSE(huge);
  EXPECT_NE(huge.error().message.find("1048576 x 8"), std::string::npos) << huge.error().message;
}

// The last byte of the leaf's block, in the file; the renderer's map sees the change.
void damageLeaf(const TwoLevelScene& scene) {
  const lod::patch::Group& group = scene.file().hierarchy().groups[1];
  const auto last = static_cast<std::streamoff>(group.block_offset + group.block_bytes - 1);
  std::fstream file(scene.path(), std::ios::in | std::ios::out | std::ios::binary);
  file.seekg(last);
  const int before = file.get();
  file.seekp(last);
  file.put(static_cast<char>(before ^ 0x5A));
}

TEST_F(SceneRendererTest, damagedPatchIsAnErrorThatNamesTheFileAndTheNextPictureStillWorks) {
  TwoLevelScene scene({kKnown}, {{kKnown}}, 0.5F);
  damageLeaf(scene);
  auto renderer = rendererOf(scene);
  const auto fine = renderer->render(cameraAt(8, 8), {0.0F, 1});
  ASSERT_FALSE(fine);
  EXPECT_NE(fine.error().message.find(scene.path()), std::string::npos) << fine.error().message;
  const auto coarse = renderer->render(cameraAt(8, 8), {100.0F, 1});
  EXPECT_TRUE(coarse) << coarse.error().message;
}

TEST_F(SceneRendererTest, afterAnErrorNothingOfTheCallIsDelivered) {
  TwoLevelScene scene({kKnown}, {{kKnown}}, 0.5F);
  auto renderer = rendererOf(scene);
  int delivered = 0;
  const auto take = [&](std::size_t, const RenderedPicture&) { ++delivered; };
  ASSERT_TRUE(renderer->renderMany({cameraAt(8, 8)}, {100.0F, 1}, take));  // the root: on its way
  damageLeaf(scene);
  EXPECT_FALSE(renderer->renderMany({cameraAt(8, 8)}, {0.0F, 1}, take));
  ASSERT_TRUE(renderer->finish());
  EXPECT_EQ(delivered, 0);
}

TEST_F(SceneRendererTest, withoutAContextCreateSaysWhatToDo) {
  TwoLevelScene scene({kKnown}, {{kKnown}}, 0.1F);
  context_->release();
  const auto renderer = SceneRenderer::create(scene.scene(), scene.file());
  ASSERT_FALSE(renderer);
  EXPECT_NE(renderer.error().message.find("HeadlessContext"), std::string::npos);
  context_->makeCurrent();
}

TEST_F(SceneRendererTest, sceneSphereHoldsTheModel) {
  TwoLevelScene scene({kKnown}, {{kKnown}}, 0.1F);
  auto renderer = rendererOf(scene);
  for (const glm::vec3& corner : {kKnown.a, kKnown.b, kKnown.c})
    EXPECT_LE(glm::length(corner - renderer->sceneCenter()), renderer->sceneRadius() * 1.0001F);
}

}  // namespace
}  // namespace server
