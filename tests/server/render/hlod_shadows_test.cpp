// Shadows in pictures of built scenes, against what rays say of the leaves' triangles.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <optional>
#include <ostream>
#include <vector>

#include "base/egl/headless.h"
#include "base/file.h"
#include "base/gl/gl.h"
#include "base/jpeg/jpeg.h"
#include "lod/disk_bytes.h"
#include "lod/hlod/block.h"
#include "lod/hlod/builder/build.h"
#include "lod/patch/builder/hierarchy_build.h"
#include "mesh/generate/sample.h"
#include "server/render/hlod_scene.h"
#include "server/render/scene_light.h"
#include "server/render/scene_renderer.h"
#include "tests/lod/draw/shadow_truth.h"
#include "tests/support/compared_pictures.h"
#include "tests/support/failure_meshes.h"
#include "tests/support/ply_file.h"
#include "tests/support/temporary_directory.h"
#include "tests/support/test_meshes.h"

namespace server {
namespace {

/// The statue stands along y, other meshes here lie across z.
const glm::dvec3 kUpwards(0.0, 0.0, 1.0);

/// The triangles of all leaves, scene-local, with their normals.
support::Mesh leavesOf(const std::string& path) {
  using namespace lod::hlod;
  const auto bytes = base::readFile(path);
  EXPECT_TRUE(bytes);
  const base::ByteView file(*bytes);
  const auto header = readHeader(file);
  EXPECT_TRUE(header);
  const auto nodes = readTable(*header, file.subspan(kHeaderBytes, header->table_bytes));
  EXPECT_TRUE(nodes);
  support::Mesh mesh;
  for (const Node& node : *nodes) {
    if (!node.isLeaf()) continue;
    const auto leaf = decodeBlock(file.subspan(node.picture.offset, node.picture.bytes), node, {header->colors, false});
    EXPECT_TRUE(leaf);
    const auto first = static_cast<std::uint32_t>(mesh.positions.size());
    for (const NodeVertex& vertex : leaf->vertices) {
      mesh.positions.push_back(header->lattice.position(vertex.place << int{node.step_bits}));
      mesh.normals.push_back(vertex.normal);
    }
    for (const std::uint32_t corner : leaf->triangles) mesh.indices.push_back(first + corner);
  }
  return mesh;
}

class HlodShadowsTest : public testing::Test {
 protected:
  void SetUp() override {
    auto context = base::HeadlessContext::create();
    ASSERT_TRUE(context) << context.error().message;
    context_ = std::move(*context);
  }
  void TearDown() override {
    renderer_.reset();
    patch_renderer_.reset();
    EXPECT_EQ(base::gl::takeError(), "");
  }

  void buildFile(const std::string& ply) {
    lod::hlod::builder::BuildOptions options;
    options.leaf_triangles = leaf_triangles_;
    const auto built = lod::hlod::builder::buildFromFiles({ply}, options, directory_ / "hlod.lgh");
    ASSERT_TRUE(built) << built.error().message;
    EXPECT_GT(built->levels.size(), 3U);
    auto opened = HlodScene::create(directory_.path(), scene_);
    ASSERT_TRUE(opened) << opened.error().message;
    renderer_ = std::move(*opened);
    leaves_ = leavesOf(directory_ / "hlod.lgh");
  }
  /// Opens patches of the same mesh for pictures in this light.
  void buildPatches(const base::Light& light) {
    const std::string path = directory_ / "patch.lgp";
    if (!patches_) {
      const auto built = lod::patch::builder::buildHierarchyFromFiles({directory_ / "mesh.ply"}, {}, path);
      ASSERT_TRUE(built) << built.error().message;
      auto opened = lod::patch::PatchFile::open(path);
      ASSERT_TRUE(opened) << opened.error().message;
      patches_.emplace(std::move(*opened));
    }
    base::Scene scene = scene_;
    scene.light = light;
    auto renderer = SceneRenderer::create(scene, *patches_);
    ASSERT_TRUE(renderer) << renderer.error().message;
    patch_renderer_ = std::move(*renderer);
  }
  void build(const support::Mesh& mesh) {
    support::writePly(directory_ / "mesh.ply", support::PlyMesh(mesh));
    buildFile(directory_ / "mesh.ply");
  }
  void buildStatue(std::uint64_t triangles) {
    mesh::generate::SampleOptions sample;
    sample.triangles = triangles;
    sample.colors = false;
    ASSERT_TRUE(mesh::generate::writeSamplePly(sample, directory_ / "mesh.ply"));
    buildFile(directory_ / "mesh.ply");
  }

  /// `from`: in radii of the scene from its middle.
  base::Camera camera(const glm::dvec3& from, int width = 320, int height = 240,
                      const glm::dvec3& up = {0.0, 1.0, 0.0}) const {
    const base::Sphere& bounds = renderer_->bounds();
    base::ViewCamera view;
    view.position = glm::dvec3(bounds.center) + static_cast<double>(bounds.radius) * from;
    view.direction = -glm::normalize(from);
    view.up = up;
    view.width = width;
    view.height = height;
    return base::cameraForScene(view, glm::dvec3(0.0), bounds);
  }
  lod::hlod::ShadowLight sun(const glm::vec3& direction, double degrees = 0.0) const {
    return {glm::vec4(glm::normalize(direction), 0.0F), static_cast<float>(degrees * std::numbers::pi / 180.0)};
  }
  /// `from`: as above; `size`: radii.
  lod::hlod::ShadowLight lamp(const glm::vec3& from, float size = 0.0F) const {
    const base::Sphere& bounds = renderer_->bounds();
    return {glm::vec4(bounds.center + bounds.radius * from, 1.0F), bounds.radius * size};
  }

  base::Image picture(const base::Camera& camera, const lod::hlod::ShadowLight& light, HlodOptions options = {}) {
    options.shadows = light.size > 0.0F ? Shadows::kSoft : Shadows::kHard;
    options.light = light;
    const auto drawn = renderer_->render(camera, options);
    EXPECT_TRUE(drawn) << drawn.error().message;
    return drawn ? drawn->rgba : base::Image(camera.width, camera.height, 4);
  }

  const support::TemporaryDirectory directory_;
  std::unique_ptr<base::HeadlessContext> context_;
  base::Scene scene_;
  std::uint32_t leaf_triangles_ = 1000;
  std::unique_ptr<HlodScene> renderer_;
  std::optional<lod::patch::PatchFile> patches_;
  std::unique_ptr<SceneRenderer> patch_renderer_;
  support::Mesh leaves_;
};

TEST_F(HlodShadowsTest, hardShadowsOfTheStatueEndWhereRaysSay) {
  buildStatue(150'000);
  const support::ShadowTruth truth(leaves_);
  HlodOptions options;
  for (const float tolerance : {0.01F, 0.5F}) {
    options.tolerance = tolerance;
    int edges = 0, wrong = 0;
    for (const lod::hlod::ShadowLight& light :
         {sun({0.6F, 0.8F, 0.3F}), sun({0.3F, 0.9F, 0.5F}), lamp({1.4F, 1.2F, 1.2F})}) {
      const base::Camera view = camera({0.7, 0.6, 1.7}, 480, 360);
      const support::EdgeCount count = support::compareEdges(picture(view, light, options), view, truth, light, 0.5);
      EXPECT_GT(count.edges, 100) << light.place.x;
      edges += count.edges, wrong += count.wrong;
    }
    EXPECT_LE(wrong, edges / 100) << edges << " edges; tolerance " << tolerance;
  }
}

/// How many pixels of a convex surface, which has no shadow where it faces the light, are darker than the light says.
int shadowedPixels(const base::Image& picture, const base::Camera& view, const support::ShadowTruth& truth,
                   const lod::hlod::ShadowLight& light, double least_facing) {
  int dark = 0;
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x) {
      const auto seen = truth.seenAt(view, {x + 0.5, y + 0.5});
      if (!seen || picture.at(x, y)[3] < 255) continue;
      const double cosine = facing(*seen, light);
      if (cosine < least_facing) continue;
      dark += picture.at(x, y)[0] < 255.0 * (0.35 + 0.65 * cosine * 0.8) - 4.0 ? 1 : 0;
    }
  return dark;
}

TEST_F(HlodShadowsTest, convexAndFlatSurfacesShowNoSpeckleAndNoSeam) {
  // The plate is tilted, so that its places lie between the lattice's.
  support::Mesh plate = support::openGrid(120, 0.0F);
  for (glm::vec3& p : plate.positions) p.z += 0.31F * p.x + 0.17F * p.y;
  for (const support::Mesh& mesh : {support::bumpySphere(100, 200, 0.0F), plate}) {
    build(mesh);
    const support::ShadowTruth truth(leaves_);
    for (int turn = 0; turn < 6; ++turn)
      for (const double degrees : {0.0, 3.0}) {
        const float angle = 1.1F * static_cast<float>(turn);
        // The lower the light the flatter it falls on the plate.
        const auto light =
            sun({std::cos(angle), std::sin(angle), 0.35F + 0.2F * static_cast<float>(turn % 3)}, degrees);
        const base::Camera view = camera({0.4, -1.5, 1.6}, 320, 240, kUpwards);
        EXPECT_EQ(shadowedPixels(picture(view, light), view, truth, light, 0.1), 0) << turn << ", " << degrees;
      }
  }
}

/// A cube whose normals are those between its sides along the edges, and lean away from an eye that sees its top flat.
TEST_F(HlodShadowsTest, edgesOfABoxAreNotDark) {
  leaf_triangles_ = 10;  // for some levels
  build(support::box(glm::vec3(-1.0F), glm::vec3(1.0F), 8));
  const support::ShadowTruth truth(leaves_);
  const auto light = sun({0.1F, -0.2F, 1.0F}, 0.0);
  for (const double height : {0.65, 0.8, 1.2}) {
    const base::Camera view = camera({0.4, -1.6, height}, 320, 240, kUpwards);
    const base::Image drawn = picture(view, light);
    int top = 0, dark = 0;
    for (int y = 0; y < drawn.height; ++y)
      for (int x = 0; x < drawn.width; ++x) {
        const auto seen = truth.seenAt(view, {x + 0.5, y + 0.5});
        if (!seen || drawn.at(x, y)[3] < 255 || seen->plane.z < 0.9) continue;
        ++top;
        dark += drawn.at(x, y)[0] < 255.0 * 0.5 ? 1 : 0;
      }
    EXPECT_GT(top, 1000);
    EXPECT_LE(1000 * dark, top) << dark << " of " << top << " from the height " << height;
  }
}

TEST_F(HlodShadowsTest, softShadowsOfTheStatueAreNearToThoseOfManySamples) {
  buildStatue(40'000);
  const support::ShadowTruth truth(leaves_);
  HlodOptions options;
  options.supersampling = 2;
  for (const lod::hlod::ShadowLight& light : {sun({0.6F, 0.8F, 0.3F}, 8.0), lamp({1.4F, 1.2F, 1.2F}, 0.4F)}) {
    const base::Camera view = camera({0.7, 0.6, 1.7});
    const support::PenumbraError error =
        support::comparePenumbrae(picture(view, light, options), view, truth, light, 2);
    EXPECT_GT(error.pixels, 300);
    EXPECT_LT(error.mean, 4.0) << error.pixels << " pixels, largest " << error.largest;
  }
}

TEST_F(HlodShadowsTest, lightAmidTheSceneThrowsShadowsToAllSides) {
  support::Mesh mesh = support::openGrid(60, 0.0F);
  for (int i = 0; i < 5; ++i) {
    const float angle = 1.2F * static_cast<float>(i);
    const glm::vec3 foot(0.6F * std::cos(angle), 0.6F * std::sin(angle), 0.0F);
    support::append(mesh, support::box(foot - 0.05F, foot + glm::vec3(0.05F, 0.05F, 0.5F), 6));
  }
  build(mesh);
  const support::ShadowTruth truth(leaves_);
  const lod::hlod::ShadowLight light = {glm::vec4(0.02F, 0.03F, 0.35F, 1.0F), 0.0F};
  const base::Camera view = camera({0.3, -1.8, 1.6}, 320, 240, kUpwards);
  const support::EdgeCount count = support::compareEdges(picture(view, light), view, truth, light, 0.3);
  EXPECT_GT(count.edges, 150);
  EXPECT_LE(count.wrong, count.edges / 100) << count.edges << " edges, " << count.checked << " pixels";
}

TEST_F(HlodShadowsTest, aPictureInTilesIsThatInOne) {
  buildStatue(20'000);
  const base::Camera view = camera({0.7, 0.6, 1.7}, 160, 120);
  for (const double degrees : {0.0, 3.0}) {
    const auto light = sun({-0.5F, 0.6F, 0.7F}, degrees);
    HlodOptions tiles;
    tiles.max_target_samples = 6000;
    const base::Image whole = picture(view, light), tiled = picture(view, light, tiles);
    EXPECT_LT(support::shareDifferent(whole, tiled), 0.01) << degrees;
  }
}

/// The mean difference of pixels that all of the light would make brighter than `expected` is, of 255.
struct ShadowDifference {
  double mean = 0.0;
  int pixels = 0;
};
ShadowDifference compareInShadow(const base::Image& expected, const base::Image& got, const base::Camera& view,
                                 const support::ShadowTruth& truth, const lod::hlod::ShadowLight& light) {
  ShadowDifference difference;
  for (int y = 0; y < view.height; ++y)
    for (int x = 0; x < view.width; ++x) {
      if (expected.at(x, y)[3] < 255 || got.at(x, y)[3] < 255) continue;
      const auto seen = truth.seenAt(view, {x + 0.5, y + 0.5});
      if (!seen || expected.at(x, y)[0] > 255.0 * (0.35 + 0.65 * facing(*seen, light)) - 8.0) continue;
      difference.mean += std::abs(static_cast<double>(expected.at(x, y)[0]) - static_cast<double>(got.at(x, y)[0]));
      ++difference.pixels;
    }
  difference.mean /= std::max(difference.pixels, 1);
  return difference;
}

// Faces are drawn many at a time, frames and pictures alone.
TEST_F(HlodShadowsTest, patchesShowTheShadowsThatNodesShow) {
  buildStatue(40'000);
  const support::ShadowTruth truth(leaves_);
  const base::Sphere& bounds = renderer_->bounds();
  const glm::dvec3 lamp(bounds.center + bounds.radius * glm::vec3(1.4F, 1.2F, 1.2F));
  RenderOptions options;
  options.tolerance_px = 0.0F;  // as faces are drawn
  options.supersampling = 2;
  HlodOptions as_nodes;
  as_nodes.supersampling = 2;
  for (const base::Light& light :
       {base::Light{base::LightMode::kSoftShadows, glm::normalize(glm::vec3(0.6F, 0.8F, 0.3F)), {}, 8.0},
        base::Light{base::LightMode::kSoftShadows, {0.0F, 1.0F, 0.0F}, lamp, 0.4 * static_cast<double>(bounds.radius)},
        base::Light{base::LightMode::kHardShadows, glm::normalize(glm::vec3(0.6F, 0.8F, 0.3F)), {}, 0.0}}) {
    buildPatches(light);
    const lod::hlod::ShadowLight thrown = shadowsOf(light, glm::dvec3(0.0)).light;
    std::vector<base::Camera> views{camera({0.7, 0.6, 1.7}), camera({0.7, 0.6, 1.7}, 200, 200)};
    const auto check = [&](std::size_t i, const RenderedPicture& drawn) {
      const auto difference = compareInShadow(picture(views[i], thrown, as_nodes), drawn.rgba, views[i], truth, thrown);
      EXPECT_GT(difference.pixels, 500);
      EXPECT_LT(difference.mean, 4.0) << difference.pixels << " pixels, light " << base::nameOf(light.mode);
    };
    // With maps of the whole scene, too, which a picture before has drawn or not.
    for (const bool one_of_many : {false, true, true}) {
      options.one_of_many = one_of_many;
      ASSERT_TRUE(patch_renderer_->renderMany(views, options, check));
      ASSERT_TRUE(patch_renderer_->finish());
    }
    options.one_of_many = false;
    const auto one = patch_renderer_->render(views[0], options);
    ASSERT_TRUE(one) << one.error().message;
    check(0, *one);
    // Tiles that are only wished for would have maps of their own.
    options.tile_samples = 20'000;
    const auto whole = patch_renderer_->render(views[0], options);
    ASSERT_TRUE(whole) << whole.error().message;
    EXPECT_EQ(whole->rgba.pixels, one->rgba.pixels);
    options.tile_samples = RenderOptions{}.tile_samples;
    options.max_target_samples = 20'000;
    const auto in_tiles = patch_renderer_->render(views[0], options);
    ASSERT_TRUE(in_tiles) << in_tiles.error().message;
    EXPECT_LT(support::shareDifferent(one->rgba, in_tiles->rgba), 0.02);
    options.max_target_samples = RenderOptions{}.max_target_samples;
  }
}

// Faces and frames are drawn from leaves.
TEST_F(HlodShadowsTest, leavesOfAConvexSurfaceShowNoSpeckle) {
  build(support::bumpySphere(100, 200, 0.0F));
  const support::ShadowTruth truth(leaves_);
  const base::Camera view = camera({0.4, -1.5, 1.6}, 320, 240, kUpwards);
  const base::Light light{base::LightMode::kSoftShadows, glm::normalize(glm::vec3(0.5F, -0.6F, 0.4F)), {}, 3.0};
  buildPatches(light);
  const auto drawn = patch_renderer_->render(view, {.tolerance_px = 0.0F});
  ASSERT_TRUE(drawn) << drawn.error().message;
  EXPECT_EQ(shadowedPixels(drawn->rgba, view, truth, shadowsOf(light, glm::dvec3(0.0)).light, 0.1), 0);
}

TEST_F(HlodShadowsTest, patchesNeedTheOctreeForShadows) {
  buildStatue(10'000);
  buildPatches({});
  std::filesystem::remove(directory_ / "hlod.lgh");
  const auto lit = patch_renderer_->setLight({base::LightMode::kHardShadows, {0.0F, 1.0F, 0.0F}, {}, 0.0});
  ASSERT_FALSE(lit);
  EXPECT_NE(lit.error().message.find("--methods hlod"), std::string::npos) << lit.error().message;
}

TEST_F(HlodShadowsTest, softShadowsNeedALightOfSomeSize) {
  buildStatue(10'000);
  HlodOptions options;
  options.shadows = Shadows::kSoft;
  const auto drawn = renderer_->render(camera({0.7, 0.6, 1.7}), options);
  ASSERT_FALSE(drawn);
  EXPECT_NE(drawn.error().message.find("size"), std::string::npos) << drawn.error().message;
}

// ---- where shadows may fail (docs/stability.md) ----

/// A surface, a view of it and a light that is hard on shadows.
struct ShadowFailure {
  const char* name;
  support::Mesh (*mesh)();
  glm::dvec3 from;  ///< as of camera()
  glm::vec3 light;  ///< towards the sun, or a lamp's place in radii
  bool is_lamp = false;
  double least_facing = 0.2;  ///< cosine from which on pixels count
  double max_wrong = 0.01;    ///< share of the edges' pixels
};
void PrintTo(const ShadowFailure& failure, std::ostream* out) {
  *out << failure.name;
}

support::Mesh ballsOnAPlate() {
  support::Mesh mesh = support::openGrid(100, 0.02F);
  for (int i = 0; i < 5; ++i) {
    const float angle = 1.2566F * static_cast<float>(i);
    const glm::vec3 middle(0.5F + 0.25F * std::cos(angle), 0.5F + 0.25F * std::sin(angle), 0.08F);
    support::append(mesh, support::bumpySphere(30, 60, 0.1F, middle, 0.06F));
  }
  return mesh;
}
support::Mesh wiresOverAPlate() {
  support::Mesh mesh = support::box({-1.3F, -1.3F, -0.8F}, {1.3F, 1.3F, -0.75F}, 40);
  support::append(mesh, support::wires());
  return mesh;
}
support::Mesh ballsFarAway() {
  support::Mesh mesh = ballsOnAPlate();
  mesh.origin = {1e6, 4e6, 100.0};
  return mesh;
}

const std::vector<ShadowFailure>& shadowFailures() {
  static const std::vector<ShadowFailure> all{
      {"even_light", ballsOnAPlate, {0.4, -1.0, 1.2}, {0.5F, 0.3F, 0.8F}},
      {"grazing_light", ballsOnAPlate, {0.4, -1.0, 1.2}, {0.97F, 0.2F, 0.12F}, false, 0.1},
      // A wire's two edges are each off by their own error.
      {"thin_casters", wiresOverAPlate, {0.5, -1.0, 1.4}, {0.3F, 0.2F, 0.9F}, false, 0.2, 0.03},
      // Below the rim the wall takes normals from the rim's upper side.
      {"concave_interior", support::cup, {0.35, 0.2, 1.9}, {0.1F, 0.05F, 0.99F}, false, 0.2, 0.12},
      {"light_inside_the_model", support::room, {-0.55, -0.5, 0.05}, {0.02F, 0.05F, 0.1F}, true},
      {"giant_receiver", support::ballOnAGiant, {0.25, -0.5, 0.35}, {0.5F, 0.3F, 0.6F}, false, 0.2, 0.02},
      {"coordinates_of_a_million", ballsFarAway, {0.4, -1.0, 1.2}, {0.5F, 0.3F, 0.8F}},
  };
  return all;
}

class ShadowFailuresTest : public HlodShadowsTest, public testing::WithParamInterface<ShadowFailure> {
 protected:
  static std::string folder() {
    const char* folder = std::getenv("LUMIGRID_STABILITY");
    return folder == nullptr ? "" : folder;
  }

  /// The picture that rays give: 2 x 2 places a pixel, `rays` to the light from each.
  static base::Image rayPicture(const base::Camera& view, const support::ShadowTruth& truth,
                                const lod::hlod::ShadowLight& light, int rays) {
    constexpr int kPlaces = 2;
    base::Image picture(view.width, view.height, 4);
    for (int y = 0; y < view.height; ++y)
      for (int x = 0; x < view.width; ++x) {
        double brightness = 0.0;
        int seen_places = 0;
        for (int i = 0; i < kPlaces * kPlaces; ++i) {
          const auto seen =
              truth.seenAt(view, glm::dvec2(x + (i % kPlaces + 0.5) / kPlaces, y + (i / kPlaces + 0.5) / kPlaces));
          if (!seen) continue;
          ++seen_places;
          const double lit =
              rays > 1 ? truth.litShare(*seen, light, rays) : (truth.isLit(*seen, glm::dvec4(light.place)) ? 1.0 : 0.0);
          brightness += 0.35 + 0.65 * std::max(support::facing(*seen, light), 0.0) * lit;
        }
        const auto grey = static_cast<std::uint8_t>(255.0 * brightness / std::max(seen_places, 1));
        const std::array<std::uint8_t, 4> pixel{grey, grey, grey,
                                                static_cast<std::uint8_t>(255 * seen_places / (kPlaces * kPlaces))};
        std::copy_n(pixel.data(), 4, picture.at(x, y));
      }
    return picture;
  }

  // ---- the picture of docs/stability.md: a row for each failure ----

  static constexpr int kWidth = 240, kHeight = 180;
  inline static std::vector<base::Image> sheet_;

  /// Adds hard shadows by rays and as drawn, soft ones by rays and as drawn.
  void addToSheet(const base::Camera& view, const support::ShadowTruth& truth, lod::hlod::ShadowLight light,
                  float soft_size) {
    HlodOptions options;
    options.supersampling = 2;
    sheet_.push_back(rayPicture(view, truth, light, 1));
    sheet_.push_back(picture(view, light, options));
    light.size = soft_size;
    sheet_.push_back(rayPicture(view, truth, light, 32));
    sheet_.push_back(picture(view, light, options));
    const support::PenumbraError error = support::comparePenumbrae(sheet_.back(), view, truth, light, 2);
    std::printf("penumbrae of %s: %.2f of 255, %d pixels\n", GetParam().name, error.mean, error.pixels);
  }
  static void TearDownTestSuite() {
    if (sheet_.empty()) return;
    base::Image all(4 * kWidth, static_cast<int>(sheet_.size() / 4) * kHeight, 3);
    for (std::size_t k = 0; k < sheet_.size(); ++k)
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
          const auto from = sheet_[k].at(x, y);
          const auto to = all.at(static_cast<int>(k % 4) * kWidth + x, static_cast<int>(k / 4) * kHeight + y);
          for (int c = 0; c < 3; ++c)
            to[c] = static_cast<std::uint8_t>((from[c] * from[3] + 128 * (255 - from[3])) / 255);
        }
    const auto jpeg = base::encodeJpeg(all, 85, base::Subsampling::k420);
    ASSERT_TRUE(jpeg);
    EXPECT_TRUE(base::writeFileAtomically(folder() + "/shadows.jpg", *jpeg));
  }
};

TEST_P(ShadowFailuresTest, hardShadowsEndWhereRaysSay) {
  const ShadowFailure& failure = GetParam();
  support::writePly(directory_ / "mesh.ply", failure.mesh());
  buildFile(directory_ / "mesh.ply");
  const support::ShadowTruth truth(leaves_);
  const lod::hlod::ShadowLight light = failure.is_lamp ? lamp(failure.light) : sun(failure.light);
  const base::Camera view = camera(failure.from, kWidth, kHeight, kUpwards);
  const support::EdgeCount count =
      support::compareEdges(picture(view, light), view, truth, light, failure.least_facing);
  std::printf("%s: %d of %d edges wrong, %d pixels\n", failure.name, count.wrong, count.edges, count.checked);
  EXPECT_GT(count.edges, 50);
  EXPECT_LE(count.wrong, failure.max_wrong * count.edges);
  if (!folder().empty()) addToSheet(view, truth, light, failure.is_lamp ? 0.1F * renderer_->bounds().radius : 0.14F);
}

INSTANTIATE_TEST_SUITE_P(Where, ShadowFailuresTest, testing::ValuesIn(shadowFailures()),
                         [](const auto& failure) { return failure.param.name; });

}  // namespace
}  // namespace server
