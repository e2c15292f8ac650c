// Umbrellas of a densely sampled closed shape are a surface: nothing is seen through it from anywhere, and the first
// decimated level shows what the source mesh shows.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <set>

#include "base/egl/headless.h"
#include "base/file.h"
#include "compare/accuracy.h"
#include "lod/draw/umbrellas.h"
#include "lod/pmr/builder/build.h"
#include "server/render/scene_renderer.h"
#include "server/render/tiled_picture.h"
#include "tests/support/made_scene.h"
#include "tests/support/mesh_reader.h"
#include "tests/support/random_views.h"
#include "tests/support/shapes.h"
#include "tests/support/temporary_directory.h"
#include "tests/support/test_meshes.h"
#include "tests/support/umbrella_pictures.h"

namespace {

using lod::pmr::DrawnLeaf;
using support::Mesh;

class UmbrellaSurface : public testing::Test {
 protected:
  void SetUp() override {
    auto context = base::HeadlessContext::create();
    ASSERT_TRUE(context) << context.error().message;
    context_ = std::move(*context);
    auto renderer = lod::draw::UmbrellaRenderer::create(100'000'000);
    ASSERT_TRUE(renderer) << renderer.error().message;
    renderer_ = std::move(*renderer);
  }
  void TearDown() override {
    EXPECT_EQ(base::gl::takeError(), "");
    renderer_.reset();
  }

  /// Builds pmr.lgm of the PLY file in the test's directory, and reads it.
  void buildUmbrellas(const std::string& ply) {
    const std::string path = directory_ / "pmr.lgm";
    const auto built = lod::pmr::builder::buildFromFiles({directory_ / ply}, {}, path);
    ASSERT_TRUE(built) << built.error().message;
    auto file = base::readFile(path);
    ASSERT_TRUE(file);
    built_.file = std::move(*file);
    built_.header = built->header;
    const auto leaves = lod::pmr::readTable(
        built_.header, base::ByteView(built_.file).subspan(lod::pmr::kHeaderBytes, built_.header.table_bytes));
    ASSERT_TRUE(leaves) << leaves.error().message;
    built_.leaves = *leaves;
    EXPECT_TRUE(built_.header.oriented);
  }

  /// A leaf at a level, decoded once.
  std::shared_ptr<const lod::pmr::LeafPicture> picture(std::uint32_t leaf, std::uint32_t level) {
    auto& kept = pictures_[{leaf, level}];
    if (!kept) kept = support::leafPicture(built_, leaf, level);
    return kept;
  }

  const support::TemporaryDirectory directory_;
  std::unique_ptr<base::HeadlessContext> context_;
  std::unique_ptr<lod::draw::UmbrellaRenderer> renderer_;
  support::MadePmr built_;

 private:
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::shared_ptr<const lod::pmr::LeafPicture>> pictures_;
};

// ---- Holes ----

constexpr int kWidth = 160, kHeight = 120;

/// Looks at the model from 1.2 to 40 radii away; every doubling of the distance comes as often.
base::Camera randomView(support::RandomViews& random, const base::Sphere& model) {
  const auto radius = static_cast<double>(model.radius);
  const glm::dvec3 center(model.center);
  base::ViewCamera view;
  view.position = center + radius * 1.2 * std::pow(40.0 / 1.2, random.number(0.0, 1.0)) * random.direction();
  view.direction = glm::normalize(center + random.number(0.0, 0.3) * radius * random.direction() - view.position);
  view.up = random.direction();
  view.width = kWidth;
  view.height = kHeight;
  return base::cameraForScene(view, glm::dvec3(0.0), model);
}

/// Paints what faces the viewer red, and the farther from the viewer, the greener.
void paintSides(std::vector<DrawnLeaf>& leaves, const base::Camera& camera, const base::Sphere& model) {
  const float nearest = glm::length(camera.eye - model.center) - model.radius;
  for (DrawnLeaf& leaf : leaves) {
    auto painted = std::make_shared<lod::pmr::LeafPicture>(*leaf.picture);
    for (lod::pmr::Vertex& vertex : painted->vertices) {
      const glm::vec3 normal(vertex.normal[0], vertex.normal[1], vertex.normal[2]);
      const bool faces = glm::dot(normal, camera.eye - vertex.position) > 0.0F;
      const float depth = (glm::length(camera.eye - vertex.position) - nearest) / (2.0F * model.radius);
      const auto green = static_cast<std::uint8_t>(255.0F * glm::clamp(depth, 0.0F, 1.0F));
      vertex.color = glm::u8vec4(faces ? 255 : 0, green, 0, 255);
    }
    leaf.picture = std::move(painted);
  }
}

bool isCovered(const base::Image& painted, int x, int y) {
  return painted.at(x, y)[3] != 0;
}
bool isFront(const base::Image& painted, int x, int y) {
  return isCovered(painted, x, y) && painted.at(x, y)[0] > 250;
}

/// Whether the pixel and all around it show the front.
bool isWellInside(const base::Image& painted, int x, int y) {
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx)
      if (!isFront(painted, x + dx, y + dy)) return false;
  return true;
}

/// Returns the pixels of the background whose four neighbours are covered, and those of a back whose four neighbours
/// show the front.
std::vector<glm::ivec2> findGaps(const base::Image& painted) {
  const auto around = [&](const auto& holds, int x, int y) {
    return holds(painted, x - 1, y) && holds(painted, x + 1, y) && holds(painted, x, y - 1) && holds(painted, x, y + 1);
  };
  std::vector<glm::ivec2> gaps;
  for (int y = 1; y + 1 < painted.height; ++y)
    for (int x = 1; x + 1 < painted.width; ++x)
      if (isCovered(painted, x, y) ? painted.at(x, y)[0] < 128 && around(isFront, x, y) : around(isCovered, x, y))
        gaps.emplace_back(x, y);
  return gaps;
}

std::uint64_t coveredPixels(const base::Image& painted) {
  std::uint64_t covered = 0;
  for (std::size_t i = 3; i < painted.pixels.size(); i += 4) covered += painted.pixels[i] != 0 ? 1 : 0;
  return covered;
}

/// Sums over all pictures.
struct Seen {
  std::uint64_t foreground = 0;             ///< pixels
  std::uint64_t holes = 0;                  ///< gaps with background where the shape is
  std::uint64_t through = 0;                ///< gaps that show a back, well behind the front that is there
  std::uint64_t points = 0, triangles = 0;  ///< that were drawn
  std::set<std::uint32_t> levels;
};

class UmbrellaHoles : public UmbrellaSurface {
 protected:
  Seen lookAround(int views, unsigned seed) {
    auto target = base::gl::RenderTarget::create(kWidth, kHeight);
    EXPECT_TRUE(target);
    target_ = std::move(*target);
    Seen seen;
    support::RandomViews random(seed, built_.header.bounds, kWidth);
    const lod::pmr::Octree octree(built_.leaves);
    std::vector<lod::pmr::ChosenLeaf> chosen;
    for (int i = 0; i < views; ++i) {
      const base::Camera camera = randomView(random, built_.header.bounds);
      octree.choose(built_.leaves, {.camera = camera}, chosen);
      std::vector<DrawnLeaf> leaves;
      for (const lod::pmr::ChosenLeaf& leaf : chosen) {
        leaves.push_back({leaf.pixel, leaf.level, picture(leaf.leaf, leaf.level)});
        seen.levels.insert(leaf.level);
      }
      const base::Image painted = paint(std::move(leaves), camera);
      seen.points += count_.points;
      seen.triangles += count_.triangles;
      seen.foreground += coveredPixels(painted);
      judge(findGaps(painted), painted, camera, seen);
    }
    return seen;
  }

  static void expectClosed(const Seen& seen) {
    EXPECT_GT(seen.foreground, 800'000U);
    EXPECT_LE(seen.holes, seen.foreground / 100'000);
    EXPECT_LE(seen.through, seen.foreground / 100'000);
    EXPECT_EQ(seen.levels.size(), lod::pmr::kLevels);
    EXPECT_GT(seen.points, 100'000U);
    EXPECT_GT(seen.triangles, 1'000'000U);
  }

 private:
  base::Image paint(std::vector<DrawnLeaf> leaves, const base::Camera& camera) {
    paintSides(leaves, camera, built_.header.bounds);
    lod::draw::UmbrellaView view;
    view.camera = camera;
    view.shading.unlit = true;
    view.oriented = true;
    target_.bind();
    glDepthMask(GL_TRUE);
    glClearColor(0, 0, 0, 0);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    const auto drawn = renderer_->draw(leaves, view, {target_.framebuffer(), kWidth, kHeight});
    EXPECT_TRUE(drawn);
    count_ = *drawn;
    return target_.read();
  }

  /// A gap may also be one of the shape, between its parts, or the outline of a fold: the finest triangles tell.
  void judge(const std::vector<glm::ivec2>& gaps, const base::Image& painted, const base::Camera& camera, Seen& seen) {
    constexpr int kFarther = 8;  // 255ths of the model's diameter
    if (gaps.empty()) return;
    std::vector<DrawnLeaf> finest;
    for (std::uint32_t leaf = 0; leaf < built_.leaves.size(); ++leaf) finest.push_back({0.0F, 0, picture(leaf, 0)});
    const base::Image truth = paint(std::move(finest), camera);
    for (const glm::ivec2& gap : gaps) {
      if (!isCovered(painted, gap.x, gap.y))
        seen.holes += isFront(truth, gap.x, gap.y) ? 1 : 0;
      else if (painted.at(gap.x, gap.y)[1] > truth.at(gap.x, gap.y)[1] + kFarther)
        seen.through += isWellInside(truth, gap.x, gap.y) ? 1 : 0;
    }
  }

  base::gl::RenderTarget target_;
  lod::draw::UmbrellaCount count_;  ///< of the last picture
};

TEST_F(UmbrellaHoles, aTorusOfRandomPointsIsClosedFromAnywhere) {
  support::PlyMesh points;
  for (const auto& sample : support::torusSamples(1.0, 0.35, 60'000, 7)) {
    points.add(sample.place);
    points.normals.emplace_back(sample.normal);
  }
  support::writePly(directory_ / "torus.ply", points);
  buildUmbrellas("torus.ply");
  expectClosed(lookAround(500, 1));
}

TEST_F(UmbrellaHoles, aStatueIsClosedFromAnywhere) {
  mesh::generate::SampleOptions sample;
  sample.triangles = 120'000;
  support::writePly(directory_ / "statue.ply", support::makeSample(sample));
  buildUmbrellas("statue.ply");
  expectClosed(lookAround(500, 2));
}

// ---- The picture of level 1 ----

/// Bounds lie a quarter above what was measured, 0.55 and 0.65 levels.
class UmbrellaPictures : public UmbrellaSurface {
 protected:
  static constexpr int kSamples = 4;

  /// Draws the mesh and its umbrellas of a level, all of them as triangles, from around and near. Returns the largest
  /// mean difference, 8-bit levels.
  double largestDifference(const Mesh& mesh, std::uint32_t level) {
    support::writePly(directory_ / "mesh.ply", mesh);
    buildUmbrellas("mesh.ply");
    const auto scene = support::makeScene(mesh, directory_.path());
    EXPECT_TRUE(scene) << scene.error().message;
    const auto patches = lod::patch::PatchFile::open(directory_ / "patch.lgp");
    EXPECT_TRUE(patches);
    const auto renderer = server::SceneRenderer::create(*scene, *patches);
    EXPECT_TRUE(renderer);
    const auto tiles = server::TiledPicture::create();
    EXPECT_TRUE(tiles);
    double largest = 0.0;
    for (const glm::dvec3& from : {glm::dvec3(2.6, 1.0, 0.8), {-1.0, 2.0, -1.6}, {-0.5, -1.1, 0.6}}) {
      const base::Camera camera = cameraAt(from);
      const auto truth = (*renderer)->render(camera, {.tolerance_px = 0.0F, .supersampling = kSamples});
      const auto drawn = drawLevel(**tiles, camera, level);
      EXPECT_TRUE(truth && drawn);
      const auto accuracy = compare::measureAccuracy(truth->rgba, *drawn);
      EXPECT_TRUE(accuracy);
      largest = std::max(largest, accuracy->mean_abs);
    }
    return largest;
  }

 private:
  base::Camera cameraAt(const glm::dvec3& from_in_radii) const {
    const base::Sphere& model = built_.header.bounds;
    base::ViewCamera view;
    view.position = glm::dvec3(model.center) + static_cast<double>(model.radius) * from_in_radii;
    view.direction = -glm::normalize(from_in_radii);
    view.up = {0, 0, 1};
    view.width = 320;
    view.height = 240;
    return base::cameraForScene(view, glm::dvec3(0.0), model);
  }

  base::Result<base::Image> drawLevel(server::TiledPicture& tiles, const base::Camera& camera, std::uint32_t level) {
    std::vector<DrawnLeaf> leaves;
    for (std::uint32_t leaf = 0; leaf < built_.leaves.size(); ++leaf)
      leaves.push_back({0.0F, level, picture(leaf, level)});
    lod::draw::UmbrellaView view;
    view.oriented = true;
    return tiles.draw(camera, {.supersampling = kSamples},
                      [&](const base::Camera& tile, const server::SampleTarget& target) -> base::Result<void> {
                        view.camera = tile;
                        const auto drawn = renderer_->draw(
                            leaves, view, {target.framebuffer(), tile.width * kSamples, tile.height * kSamples});
                        return drawn ? base::Result<void>() : drawn.error();
                      });
  }
};

TEST_F(UmbrellaPictures, firstDecimatedLevelOfATorusShowsTheMesh) {
  Mesh mesh = support::torus(400, 150);
  mesh.colors.clear();
  mesh.normals = support::vertexNormals(mesh);
  EXPECT_LT(largestDifference(mesh, 1), 1.0);
}

TEST_F(UmbrellaPictures, firstDecimatedLevelOfABumpySphereShowsTheMesh) {
  Mesh mesh = support::bumpySphere(170, 350);
  mesh.normals = support::vertexNormals(mesh);
  EXPECT_LT(largestDifference(mesh, 1), 1.0);
}

}  // namespace
