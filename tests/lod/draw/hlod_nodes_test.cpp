#include "lod/draw/hlod_nodes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "base/egl/headless.h"
#include "lod/draw/view_modes.h"

namespace lod::draw {
namespace {

constexpr int kSize = 120;  // pixels
constexpr float kAway = 3.0F;

using Nodes = std::vector<hlod::DrawnNode>;

base::Camera cameraAt(const glm::vec3& position, bool orthographic = false) {
  base::ViewCamera view;
  view.position = position;
  view.direction = -glm::normalize(view.position);
  view.width = view.height = kSize;
  if (orthographic) view.ortho_height = 2.0;
  return base::cameraForScene(view, glm::dvec3(0.0), {glm::vec3(0.0F), 2.0F});
}

/// Looks down on the plane z = 0, on which 1 is some 48 pixels.
const base::Camera& cameraAbove() {
  static const base::Camera camera = cameraAt({0.0F, 0.0F, kAway});
  return camera;
}

float pixelAbove() {
  return kAway / cameraAbove().pixelsPerUnitAtOne();
}

NodeView unlit(const base::Camera& camera) {
  NodeView view;
  view.camera = camera;
  view.shading.unlit = true;
  return view;
}

SurfaceVertex vertexAt(const glm::vec3& position, const glm::vec3& normal = {0.0F, 0.0F, 1.0F},
                       const glm::u8vec3& color = {200, 150, 100}) {
  SurfaceVertex vertex;
  vertex.position = position;
  const glm::vec3 unit = glm::normalize(normal);
  for (int k = 0; k < 3; ++k)
    vertex.normal[static_cast<std::size_t>(k)] = static_cast<std::int8_t>(std::lround(127.0F * unit[k]));
  vertex.color = glm::u8vec4(color, 255);
  return vertex;
}

/// A node at its error in this camera's picture, as if all of it were as far away as the scene's middle.
hlod::DrawnNode drawn(const base::Camera& camera, hlod::NodePicture picture) {
  hlod::DrawnNode node;
  node.error_px = picture.error * camera.pixelsPerUnit(glm::vec3(0.0F));
  node.picture = std::make_shared<const hlod::NodePicture>(std::move(picture));
  return node;
}

/// Part of a plane as a triangulated square grid of side × side vertices.
hlod::NodePicture gridOf(int side, const std::function<glm::vec3(int x, int y)>& place,
                         const glm::vec3& normal = {0.0F, 0.0F, 1.0F}) {
  hlod::NodePicture picture;
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) picture.vertices.push_back(vertexAt(place(x, y), normal));
  for (int y = 0; y + 1 < side; ++y)
    for (int x = 0; x + 1 < side; ++x) {
      const auto a = static_cast<std::uint32_t>(y * side + x), above = a + static_cast<std::uint32_t>(side);
      for (const std::uint32_t corner : {a, a + 1, above, a + 1, above + 1, above}) picture.triangles.push_back(corner);
    }
  return picture;
}

/// The same vertices as points alone.
hlod::NodePicture asPoints(hlod::NodePicture picture) {
  picture.points = static_cast<std::uint32_t>(picture.vertices.size());
  picture.triangles.clear();
  return picture;
}

class HlodNodesTest : public testing::Test {
 protected:
  void SetUp() override {
    auto context = base::HeadlessContext::create();
    ASSERT_TRUE(context) << context.error().message;
    context_ = std::move(*context);
    makeRenderer(100'000'000);
  }
  void TearDown() override {
    EXPECT_EQ(base::gl::takeError(), "");
    renderer_.reset();
    target_ = {};
  }
  void makeRenderer(std::uint64_t gpu_bytes) {
    auto renderer = NodeRenderer::create(gpu_bytes);
    ASSERT_TRUE(renderer) << renderer.error().message;
    renderer_ = std::move(*renderer);
  }
  /// All samples of the picture.
  base::Image picture(const Nodes& nodes, const NodeView& view, int supersampling = 1) {
    const int side = kSize * supersampling;
    if (target_.width() != side) {
      auto target = base::gl::RenderTarget::create(side, side);
      EXPECT_TRUE(target);
      target_ = std::move(*target);
    }
    target_.bind();
    glDepthMask(GL_TRUE);
    glClearColor(0, 0, 0, 0);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    const auto count = renderer_->draw(nodes, view, {target_.framebuffer(), side, side});
    EXPECT_TRUE(count) << count.error().message;
    count_ = *count;
    return target_.read();
  }

  std::unique_ptr<base::HeadlessContext> context_;
  std::unique_ptr<NodeRenderer> renderer_;
  base::gl::RenderTarget target_;
  NodeCount count_;
};

/// Counts samples through which the background is seen, within `margin` of the picture's border, a share of its side.
int samplesOpen(const base::Image& picture, double margin = 0.1) {
  const int first = static_cast<int>(margin * picture.width), last = picture.width - first;
  int open = 0;
  for (int y = first; y < last; ++y)
    for (int x = first; x < last; ++x) open += picture.at(x, y)[3] == 0 ? 1 : 0;
  return open;
}

/// Two halves of the plane with a crack between them that is as wide as both errors together. It runs through the
/// picture's middle, in direction `angle`, and if it is jagged, touches that line now and then.
Nodes halvesWithCrack(const base::Camera& camera, float error, float angle, bool jagged, std::mt19937& random) {
  constexpr int kSteps = 40;
  const glm::vec3 along(std::cos(angle), std::sin(angle), 0.0F), across(-along.y, along.x, 0.0F);
  std::uniform_real_distribution<float> share(jagged ? 0.0F : 1.0F, 1.0F);
  std::uniform_real_distribution<float> shift(-0.5F, 0.5F);
  const glm::vec3 middle = shift(random) * pixelAbove() * along + shift(random) * pixelAbove() * across;
  Nodes halves;
  for (const float side : {-1.0F, 1.0F}) {
    hlod::NodePicture picture;
    picture.error = error;
    for (int i = 0; i <= kSteps; ++i) {
      const glm::vec3 on_cut = middle + (static_cast<float>(2 * i) / kSteps - 1.0F) * 3.0F * along;
      picture.vertices.push_back(vertexAt(on_cut + side * share(random) * error * across));
      picture.vertices.push_back(vertexAt(on_cut + side * 3.0F * across));
    }
    for (std::uint32_t a = 0; a + 3 < picture.vertices.size(); a += 2) {
      for (const std::uint32_t corner : {a, a + 1, a + 2, a + 1, a + 3, a + 2}) picture.triangles.push_back(corner);
      for (const std::uint32_t end : {a, a + 2}) picture.edges.push_back(end);
    }
    halves.push_back(drawn(camera, std::move(picture)));
  }
  return halves;
}

Nodes withoutLines(const Nodes& nodes) {
  Nodes bare;
  for (const hlod::DrawnNode& node : nodes) {
    auto picture = std::make_shared<hlod::NodePicture>(*node.picture);
    picture->edges.clear();
    bare.push_back({node.error_px, false, std::move(picture)});
  }
  return bare;
}

TEST_F(HlodNodesTest, linesCloseCracksAsWideAsTheErrorsAtAnySupersampling) {
  std::mt19937 random(1);
  for (const int supersampling : {1, 2, 4})
    for (const float pixels : {0.5F, 0.2F, 1.5F})
      for (int turn = 0; turn < 24; ++turn) {
        const float angle = 0.13F + static_cast<float>(turn) * 0.2618F;  // of 24 steps, none along an axis
        const Nodes halves = halvesWithCrack(cameraAbove(), pixels * pixelAbove(), angle, turn % 2 == 1, random);
        const NodeView view = unlit(cameraAbove());
        EXPECT_EQ(samplesOpen(picture(halves, view, supersampling)), 0)
            << supersampling << " samples, error of " << pixels << " pixels, angle " << angle;
        EXPECT_EQ(count_.lines, 80U);
        if (pixels * static_cast<float>(supersampling) >= 0.5F) {
          EXPECT_GT(samplesOpen(picture(withoutLines(halves), view, supersampling)), 0) << angle;
        }
      }
}

TEST_F(HlodNodesTest, linesCloseCracksInObliqueAndParallelViews) {
  std::mt19937 random(2);
  for (const bool orthographic : {false, true})
    for (int turn = 0; turn < 12; ++turn) {
      const float angle = static_cast<float>(turn) * 0.5236F;
      const base::Camera camera =
          cameraAt(kAway * glm::normalize(glm::vec3(std::cos(angle), 0.4F, 1.2F)), orthographic);
      const float error = 0.5F / camera.pixelsPerUnit(glm::vec3(0.0F));
      Nodes halves = halvesWithCrack(camera, error, 0.3F, false, random);
      // The nearest places of a node are larger on the screen.
      for (hlod::DrawnNode& node : halves) node.error_px *= 3.0F;
      EXPECT_EQ(samplesOpen(picture(halves, unlit(camera), 2), 0.25), 0) << turn;
      EXPECT_GT(samplesOpen(picture(withoutLines(halves), unlit(camera), 2), 0.25), 0) << turn;
    }
}

TEST_F(HlodNodesTest, linesOfALeafCoverOneSample) {
  std::mt19937 random(3);
  const Nodes leaf = halvesWithCrack(cameraAbove(), 0.0F, 0.4F, false, random);
  Nodes half{leaf.front()};
  const auto covered = [&](const Nodes& nodes) {
    const base::Image image = picture(nodes, unlit(cameraAbove()), 4);
    return image.width * image.height - samplesOpen(image, 0.0);
  };
  const int with_lines = covered(half), without = covered(withoutLines(half));
  EXPECT_LE(with_lines - without, 4 * kSize * 2) << "a sample for each column or row that the line crosses";
  EXPECT_GE(with_lines, without);
}

/// Points on the plane so far apart that no place of it is farther than `reach` from one.
hlod::NodePicture pointsReaching(float reach, float angle) {
  const auto side = static_cast<int>(std::ceil(2.0F / (1.4142F * reach)));
  auto points = asPoints(gridOf(side, [&](int x, int y) {
    const float spacing = 1.4142F * reach;
    const glm::vec2 at = (glm::vec2(x, y) - 0.5F * static_cast<float>(side)) * spacing;
    return glm::vec3(at.x * std::cos(angle) - at.y * std::sin(angle), at.x * std::sin(angle) + at.y * std::cos(angle),
                     0.0F);
  }));
  points.error = reach;
  return points;
}

TEST_F(HlodNodesTest, pointsAsFarApartAsTheErrorLeaveNoHole) {
  for (const int supersampling : {1, 2, 4})
    for (const float pixels : {0.5F, 0.3F, 2.0F})
      for (int turn = 0; turn < 12; ++turn) {
        const float angle = static_cast<float>(turn) * 0.2618F;
        const auto points = pointsReaching(pixels * pixelAbove(), angle);
        EXPECT_EQ(samplesOpen(picture({drawn(cameraAbove(), points)}, unlit(cameraAbove()), supersampling), 0.35), 0)
            << supersampling << " samples, error of " << pixels << " pixels, angle " << angle;
        EXPECT_EQ(count_.points, points.points);
        EXPECT_EQ(count_.triangles, 0U);
      }
}

TEST_F(HlodNodesTest, aPointIsAsLargeAsItsErrorToAllSidesAndASampleAtLeast) {
  auto point = asPoints(gridOf(1, [](int, int) { return glm::vec3(0.3F, 0.2F, 0.0F); }));
  for (const int supersampling : {1, 2, 4})
    for (const float pixels : {0.0F, 0.5F, 1.5F, 5.0F}) {
      point.error = pixels * pixelAbove();
      const base::Image image = picture({drawn(cameraAbove(), point)}, unlit(cameraAbove()), supersampling);
      const double side = std::max(1.0, 2.0 * pixels * supersampling);
      const double covered = image.width * image.height - samplesOpen(image, 0.0);
      // Away from the middle a length covers a little more.
      EXPECT_GE(covered, std::floor(side) * std::floor(side)) << pixels << " pixels";
      EXPECT_LE(covered, std::ceil(1.05 * side) * std::ceil(1.05 * side)) << pixels << " pixels";
    }
}

/// Paints all vertices.
hlod::NodePicture painted(hlod::NodePicture picture, const glm::u8vec3& color) {
  for (SurfaceVertex& vertex : picture.vertices) vertex.color = glm::u8vec4(color, 255);
  return picture;
}

// The surface falls away from them, so that a point or line of the same depth all over would lie in front.
TEST_F(HlodNodesTest, pointsAndLinesDoNotCoverTrianglesBesideThem) {
  constexpr int kSide = 40;
  const auto half = [](float from) {
    return gridOf(
        kSide, [from](int x, int y) { return glm::vec3(from + x, y - kSide / 2, 0.3F * (from + x)) * pixelAbove(); });
  };
  const glm::u8vec3 red(255, 0, 0), blue(0, 0, 255);
  const auto triangles = drawn(cameraAbove(), painted(half(1.0F - kSide), red));  // up to the picture's middle
  auto points = painted(asPoints(half(1.0F)), blue);
  auto lines = painted(half(1.0F), blue);
  lines.triangles.clear();
  for (std::uint32_t y = 0; y + 1 < kSide; ++y) lines.edges.insert(lines.edges.end(), {y * kSide, (y + 1) * kSide});
  for (auto* beside : {&points, &lines}) {
    beside->error = 3.0F * pixelAbove();
    const NodeView view = unlit(cameraAbove());
    const base::Image alone = picture({drawn(view.camera, *beside)}, view);
    const base::Image both = picture({drawn(view.camera, *beside), triangles}, view);
    int over = 0, kept = 0;
    for (int y = 0; y < kSize; ++y)
      for (int x = kSize / 2 - 10; x + 1 < kSize / 2; ++x) {
        if (both.at(x, y)[0] < 255) continue;  // beyond the triangles' other ends
        ++kept;
        over += alone.at(x, y)[2] == 255 ? 1 : 0;
      }
    EXPECT_GE(kept, 9 * (kSide - 2));
    EXPECT_GT(over, kSide - 2) << "they reach to where triangles are";
  }
}

/// A grid of quarters of a pixel.
hlod::NodePicture fineSquare(const glm::vec3& normal) {
  constexpr int kSide = 160;
  return gridOf(
      kSide, [](int x, int y) { return glm::vec3(x - kSide / 2, y - kSide / 2, 0.0F) * (0.25F * pixelAbove()); },
      normal);
}

// ---- Surfaces close to each other ----

constexpr glm::u8vec3 kSeen{200, 60, 40}, kHidden{40, 60, 200};

hlod::NodePicture colored(hlod::NodePicture picture, const glm::u8vec3& color) {
  for (SurfaceVertex& vertex : picture.vertices) vertex.color = glm::u8vec4(color, 255);
  return picture;
}

int pixelsHidden(const base::Image& picture) {
  int found = 0;
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x) found += picture.at(x, y)[2] > picture.at(x, y)[0] ? 1 : 0;
  return found;
}

/// Square parts of a sheet of 4 × 4 units at this height; or all of it as two triangles.
Nodes sheet(const base::Camera& camera, float height, const glm::u8vec3& color, int parts) {
  Nodes nodes;
  const float size = 4.0F / static_cast<float>(parts);
  for (int part = 0; part < parts * parts; ++part) {
    const glm::vec2 corner = size * glm::vec2(part % parts, part / parts) - 2.0F;
    const auto place = [&](int x, int y) { return glm::vec3(corner + size * glm::vec2(x, y), height); };
    nodes.push_back(drawn(camera, colored(gridOf(2, place), color)));
  }
  return nodes;
}

// The sheets are 4 mm apart where the scene has 10 m. The eye is within the scene's sphere, and within the box of a
// node that is all of a sheet that lies aslant.
TEST_F(HlodNodesTest, aSheetHidesTheOneCloseBehindIt) {
  for (const int parts : {8, 1})
    for (const float away : {0.8F, 1.7F, 2.4F, 2.7F}) {
      base::ViewCamera at;
      at.direction = glm::normalize(glm::dvec3(-0.3, 0.4, -0.9));
      at.position = -static_cast<double>(away) * at.direction;
      at.width = at.height = kSize;
      const base::Camera camera = base::cameraForScene(at, glm::dvec3(0.0), {glm::vec3(0.0F), 2.83F});
      Nodes nodes = sheet(camera, -0.0016F, kHidden, parts);
      for (hlod::DrawnNode& node : sheet(camera, 0.0F, kSeen, parts)) nodes.push_back(std::move(node));
      const base::Image seen = picture(nodes, unlit(camera));
      EXPECT_EQ(pixelsHidden(seen), 0) << parts << " parts from " << away;
      EXPECT_GT(seen.at(kSize / 2, kSize / 2)[0], 150);
      EXPECT_EQ(renderer_->drawnCamera().clip_from_eye[0], camera.clip_from_eye[0]);
    }
}

// Each side of the wall is off by nearly its error, so that they have changed places.
TEST_F(HlodNodesTest, theFarSideOfAThinWallDoesNotShowThroughTheNearOne) {
  constexpr float kError = 0.02F;
  for (const float side : {1.0F, -1.0F}) {
    const base::Camera camera = cameraAt({0.4F, 0.3F, side * kAway});
    const auto wall = [&](float height, float facing, const glm::u8vec3& color) {
      auto grid = colored(gridOf(9, [&](int x, int y) { return glm::vec3(0.25F * glm::vec2(x, y) - 1.0F, height); },
                                 {0.0F, 0.0F, facing}),
                          color);
      grid.error = kError;
      return drawn(camera, std::move(grid));
    };
    const Nodes nodes{wall(0.9F * kError * side, -side, kHidden), wall(-0.9F * kError * side, side, kSeen)};
    const base::Image seen = picture(nodes, unlit(camera));
    EXPECT_GT(seen.at(kSize / 2, kSize / 2)[0], 150);
    int found = 0;
    for (int y = kSize / 3; y < 2 * kSize / 3; ++y)
      for (int x = kSize / 3; x < 2 * kSize / 3; ++x) found += seen.at(x, y)[2] > seen.at(x, y)[0] ? 1 : 0;
    EXPECT_EQ(found, 0);
  }
}

// ---- Looks ----

TEST_F(HlodNodesTest, pointsAndTrianglesAreShadedAlike) {
  NodeView view;
  view.camera = cameraAbove();
  for (const glm::vec3 normal : {glm::vec3(0.0F, 0.0F, 1.0F), {0.7F, 0.1F, 0.4F}, {0.2F, -0.6F, -0.5F}})
    for (const bool resolution : {false, true}) {
      view.resolution_colors = resolution;
      const auto square = fineSquare(normal);
      const base::Image triangles = picture({drawn(view.camera, square)}, view);
      const base::Image points = picture({drawn(view.camera, asPoints(square))}, view);
      int checked = 0;
      for (int y = 0; y < kSize; ++y)
        for (int x = 0; x < kSize; ++x) {
          if (triangles.at(x, y)[3] == 0 || points.at(x, y)[3] == 0) continue;
          ++checked;
          for (int c = 0; c < 3; ++c) EXPECT_NEAR(triangles.at(x, y)[c], points.at(x, y)[c], 2);
        }
      EXPECT_GT(checked, 1200);
    }
}

TEST_F(HlodNodesTest, surfacesAreLitOnTheSideThatIsSeen) {
  NodeView view;
  view.shading.light_direction = {0.0F, 0.0F, 1.0F};
  const Nodes nodes{drawn(cameraAbove(), fineSquare({0.0F, 0.0F, 1.0F}))};
  view.camera = cameraAbove();
  const base::Image front = picture(nodes, view);
  view.camera = cameraAt({0.0F, 0.0F, -kAway});
  const base::Image back = picture(nodes, view);
  const auto* lit = front.at(kSize / 2, kSize / 2);
  const auto* dark = back.at(kSize / 2, kSize / 2);
  EXPECT_NEAR(lit[0], 200, 2);
  EXPECT_EQ(dark[3], 255) << "both sides are drawn";
  EXPECT_NEAR(dark[0], 0.15 * 200, 2);
}

TEST_F(HlodNodesTest, aSectionCutsTrianglesPointsAndLinesAway) {
  const auto square = fineSquare({0.0F, 0.0F, 1.0F});
  auto lines = square;
  lines.triangles.clear();
  for (std::uint32_t i = 0; i + 1 < lines.vertices.size(); ++i)
    if ((i + 1) % 160 != 0) lines.edges.insert(lines.edges.end(), {i, i + 1});
  for (const auto& node : {square, asPoints(square), lines}) {
    NodeView view = unlit(cameraAbove());
    const auto covered = [&](const glm::vec4& section) {
      view.camera.section = section;
      return kSize * kSize - samplesOpen(picture({drawn(view.camera, node)}, view), 0.0);
    };
    const int whole = covered(base::kNoSection);
    EXPECT_GT(whole, 700);
    EXPECT_NEAR(covered({1.0F, 0.0F, 0.0F, 0.0F}), whole / 2, whole / 10);
    EXPECT_EQ(covered({1.0F, 0.0F, 0.0F, -10.0F}), 0);
  }
}

TEST_F(HlodNodesTest, resolutionColorsAreThoseOfTheErrorAndHatchedWhereFinerIsToCome) {
  NodeView view = unlit(cameraAbove());
  view.resolution_colors = true;
  for (const float pixels : {0.3F, 1.5F, 3.0F, 6.0F, 20.0F}) {
    auto square = fineSquare({0.0F, 0.0F, 1.0F});
    square.error = pixels * pixelAbove();
    std::size_t step = 0;
    while (pixels > kResolutionLegend[step].up_to_px) ++step;
    const auto& color = kResolutionLegend[step].color;
    hlod::DrawnNode node = drawn(view.camera, square);
    const base::Image plain = picture({node}, view);
    const auto* middle = plain.at(kSize / 2, kSize / 2);
    const float brightness = static_cast<float>(middle[0]) / static_cast<float>(color[0]);
    for (std::size_t c = 0; c < 3; ++c)
      EXPECT_NEAR(middle[c], brightness * static_cast<float>(color[c]), 3.0F) << pixels;
    node.awaits_finer = true;
    EXPECT_NE(picture({node}, view).pixels, plain.pixels) << "hatched";
  }
}

TEST_F(HlodNodesTest, aNodeOfManyVerticesIsDrawnAsItsHalvesAre) {
  constexpr int kSide = 300;
  const auto place = [](int x, int y) { return glm::vec3(x - kSide / 2, y - kSide / 2, 0.0F) * 0.005F; };
  const auto whole = gridOf(kSide, place);
  ASSERT_GT(whole.vertices.size(), 65536U);
  const auto part = [&](int right, int up) {
    return gridOf(kSide / 2 + 1,
                  [&](int x, int y) { return place(right * (kSide / 2 - 1) + x, up * (kSide / 2 - 1) + y); });
  };
  const NodeView view = unlit(cameraAbove());
  const base::Image one = picture({drawn(view.camera, whole)}, view);
  EXPECT_EQ(count_.triangles, 2U * 299U * 299U);
  Nodes quarters;
  for (const int right : {0, 1})
    for (const int up : {0, 1}) quarters.push_back(drawn(view.camera, part(right, up)));
  EXPECT_EQ(picture(quarters, view).pixels, one.pixels);
  EXPECT_GT(kSize * kSize - samplesOpen(one, 0.0), 3000);
}

TEST_F(HlodNodesTest, nodesOnTheGpuAreDroppedWhenUnusedAndBeyondTheLimit) {
  const NodeView view = unlit(cameraAbove());
  Nodes nodes;
  for (int i = 0; i < 8; ++i) nodes.push_back(drawn(view.camera, fineSquare({0.0F, 0.0F, 1.0F})));
  picture(nodes, view);
  const std::uint64_t all = renderer_->gpuBytes();
  EXPECT_GT(all, 8U * 160U * 160U * 20U);
  EXPECT_EQ(all, base::gl::heldBytes().buffers);
  picture({}, view);
  EXPECT_EQ(renderer_->gpuBytes(), all) << "they are kept for the next frame";
  nodes.resize(4);
  picture({}, view);
  EXPECT_EQ(renderer_->gpuBytes(), all / 2) << "nobody holds the others any more";

  makeRenderer(all / 4);
  picture(nodes, view);
  EXPECT_EQ(renderer_->gpuBytes(), all / 2) << "a frame is drawn in any case";
  picture({nodes.front()}, view);
  EXPECT_EQ(renderer_->gpuBytes(), all / 4);
}

TEST_F(HlodNodesTest, nothingIsDrawnIntoAnEmptyTarget) {
  const Nodes nodes{drawn(cameraAbove(), fineSquare({0.0F, 0.0F, 1.0F}))};
  const auto count = renderer_->draw(nodes, unlit(cameraAbove()), {0, 0, 0});
  ASSERT_TRUE(count);
  EXPECT_EQ(count->triangles, 0U);
}

}  // namespace
}  // namespace lod::draw
