#include "lod/hlod/traverse.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "tests/support/made_hlod.h"
#include "tests/support/random_views.h"

namespace lod::hlod {
namespace {

const support::MadeHlod& made() {
  static const support::MadeHlod file = support::madeHlod(4, 4, false);
  return file;
}

glm::vec2 pixelOf(const base::Camera& camera, const glm::vec3& point) {
  const glm::vec4 clip = camera.clipFromScene() * glm::vec4(point, 1.0F);
  return 0.5F * glm::vec2(static_cast<float>(camera.width) * clip.x, static_cast<float>(camera.height) * clip.y) /
         clip.w;
}

bool isSeen(const base::Camera& camera, const glm::vec3& point) {
  const glm::vec4 clip = camera.clipFromScene() * glm::vec4(point, 1.0F);
  return clip.w > 0.0F && std::abs(clip.x) <= clip.w && std::abs(clip.y) <= clip.w && std::abs(clip.z) <= clip.w;
}

TEST(HlodTraverseTest, noPlaceOfABoxMovesFartherInThePictureThanItsProjectedError) {
  support::RandomViews views(1, made().header.bounds, 500);
  int compared = 0, parallel = 0;
  float closest = 0.0F;
  for (int i = 0; i < 400; ++i) {
    const base::Camera camera = views.next();
    parallel += camera.orthographic() ? 1 : 0;
    const Node& node = made().nodes[static_cast<std::size_t>(i) % made().nodes.size()];
    const float error = 1e-3F * node.box.diagonal();
    const float pixels = projectedError(camera, node.box, error);
    ASSERT_GT(pixels, 0.0F);
    for (int k = 0; k < 100; ++k) {
      const auto part = [&] { return static_cast<float>(views.number(0.0, 1.0)); };
      const glm::vec3 p = node.box.min + glm::vec3(part(), part(), part()) * node.box.size();
      if (!isSeen(camera, p)) continue;
      ++compared;
      // Steps of that length in any direction.
      const float moved = glm::length(pixelOf(camera, p + error * glm::vec3(views.direction())) - pixelOf(camera, p));
      ASSERT_LE(moved, 1.01F * pixels + 0.005F);
      closest = std::max(closest, moved / pixels);
    }
  }
  EXPECT_GT(compared, 5000);
  EXPECT_GT(parallel, 20);
  EXPECT_GT(closest, 0.9F) << "the bound is far from what happens";
}

TEST(HlodTraverseTest, projectedErrorsAreExactStraightAhead) {
  base::ViewCamera view;
  view.position = {0.0, 0.0, 5.0};
  view.width = 200, view.height = 100;
  const base::Aabb box{glm::vec3(-1e-3F), glm::vec3(1e-3F)};
  const base::Camera camera = base::cameraFromView(view, glm::dvec3(0.0), 0.1F, 100.0F);
  const float expected = 0.2F * 100.0F / (4.999F * 2.0F * std::tan(0.5F * static_cast<float>(view.fov_y)));
  EXPECT_NEAR(projectedError(camera, box, 0.2F), expected, 1e-3F * expected);
  EXPECT_EQ(projectedError(camera, box, 0.0F), 0.0F);

  // An eye in the box may be at any distance from the surface.
  const base::Aabb around{glm::vec3(-10.0F), glm::vec3(10.0F)};
  EXPECT_EQ(projectedError(camera, around, 1e-6F), std::numeric_limits<float>::infinity());
  EXPECT_EQ(projectedError(camera, around, 0.0F), 0.0F);
  // So may one beside a box of which a part lies behind it: its distance counts.
  const base::Aabb beside{glm::vec3(1.0F, -10.0F, -10.0F), glm::vec3(10.0F)};
  EXPECT_TRUE(std::isfinite(projectedError(camera, beside, 1.0F)));

  view.ortho_height = 3.0;
  const base::Camera parallel = base::cameraFromView(view, glm::dvec3(0.0), 0.1F, 100.0F);
  for (const base::Aabb& any : {box, around}) EXPECT_NEAR(projectedError(parallel, any, 0.3F), 10.0F, 1e-4F);
}

TEST(HlodTraverseTest, childrenShowNoLargerErrorThanTheirParent) {
  support::RandomViews views(2, made().header.bounds, 500);
  for (int i = 0; i < 50; ++i) {
    const base::Camera camera = views.next();
    for (const Node& node : made().nodes)
      for (std::uint32_t c = node.first_child; c < node.first_child + node.children; ++c) {
        const Node& child = made().nodes[c];
        ASSERT_LE(projectedError(camera, child.box, child.error),
                  1.0001F * projectedError(camera, node.box, node.error));
      }
  }
}

/// Whether the request lets a place of the surface be seen.
bool isWanted(const TraverseRequest& request, const glm::vec3& p) {
  return (!request.cull || isSeen(request.tile.value_or(request.camera), p)) &&
         glm::dot(glm::vec3(request.camera.section), p) <= request.camera.section.w;
}

TEST(HlodTraverseTest, aCutShowsEachSeenPlaceOnceWithinTheTolerance) {
  support::RandomViews views(7, made().header.bounds, 400);
  std::size_t drawn = 0, places = 0, coarse = 0;
  for (int i = 0; i < 200; ++i) {
    TraverseRequest request;
    request.camera = views.next();
    request.tolerance = static_cast<float>(views.number(0.3, 6.0));
    request.cull = i % 5 != 0;
    if (i % 3 == 0)
      request.camera.section = glm::vec4(glm::vec3(views.direction()), static_cast<float>(views.number(-1.0, 1.0)));
    const std::vector<std::uint32_t> cut = chooseCut(made().nodes, request);
    drawn += cut.size();
    std::set<std::uint32_t> chosen(cut.begin(), cut.end());
    ASSERT_EQ(chosen.size(), cut.size());
    for (const std::uint32_t number : cut) {
      const Node& node = made().nodes[number];
      if (node.isLeaf()) continue;
      ++coarse;
      EXPECT_LE(projectedError(request.camera, node.box, node.error), request.tolerance);
    }
    // The way from the root to a leaf that is seen meets one node of the cut, and all before it are too coarse.
    for (int k = 0; k < 40; ++k) {
      std::uint32_t at = 0, met = 0;
      std::vector<std::uint32_t> way{0};
      while (!made().nodes[at].isLeaf()) {
        at = made().nodes[at].first_child +
             static_cast<std::uint32_t>(views.number(0.0, made().nodes[at].children - 0.01));
        way.push_back(at);
      }
      const auto vertex = made().pictures[at].vertices[static_cast<std::size_t>(views.number(0.0, 24.0))];
      if (!isWanted(request, made().header.lattice.position(vertex.place))) continue;
      ++places;
      for (const std::uint32_t number : way) {
        const Node& node = made().nodes[number];
        met += chosen.count(number) != 0 ? 1 : 0;
        const float error_px = projectedError(request.camera, node.box, node.error);
        EXPECT_TRUE(met > 0 || error_px > request.tolerance);
      }
      EXPECT_EQ(met, 1U);
    }
  }
  EXPECT_GT(places, 1000U);
  EXPECT_GT(coarse, 500U);
  EXPECT_GT(drawn, coarse);
}

TEST(HlodTraverseTest, nodesThatFaceAwayAreSkippedIfAskedFor) {
  // From below all of the square faces away.
  base::ViewCamera view;
  view.position = glm::dvec3(0.0, 0.0, -9.0);
  view.direction = glm::dvec3(0.0, 0.0, 1.0);
  TraverseRequest request;
  for (const double ortho_height : {0.0, 4.0}) {
    view.ortho_height = ortho_height;
    request.camera = base::cameraForScene(view, glm::dvec3(0.0), made().header.bounds);
    request.cull_back_faces = false;
    EXPECT_FALSE(chooseCut(made().nodes, request).empty());
    request.cull_back_faces = true;
    request.tolerance = 0.01F;
    EXPECT_TRUE(chooseCut(made().nodes, request).empty());
  }
  // No triangle that faces the eye is skipped.
  support::RandomViews views(9, made().header.bounds, 400);
  std::size_t skipped = 0;
  for (int i = 0; i < 100; ++i) {
    request.camera = views.next();
    const Sight sight(request);
    for (std::size_t n = 0; n < made().nodes.size(); ++n) {
      const Node& node = made().nodes[n];
      const base::Frustum frustum(request.camera.clipFromScene());
      if (!node.isLeaf() || !frustum.mayOverlap(node.box) || sight.maySee(node)) continue;
      ++skipped;
      const NodeGeometry& picture = made().pictures[n];
      for (std::size_t t = 0; t < picture.triangles.size(); t += 3) {
        const auto at = [&](std::size_t k) {
          return made().header.lattice.position(picture.vertices[picture.triangles[t + k]].place);
        };
        const glm::vec3 normal = glm::cross(at(1) - at(0), at(2) - at(0));
        EXPECT_LE(glm::dot(normal, request.camera.towardsViewer(at(0))), 0.0F);
      }
    }
  }
  EXPECT_GT(skipped, 100U);
}

TEST(HlodTraverseTest, aTileHasNodesOfItsPicture) {
  support::RandomViews views(3, made().header.bounds, 400);
  std::size_t fewer = 0;
  for (int i = 0; i < 100; ++i) {
    TraverseRequest request;
    request.camera = views.next();
    const std::vector<std::uint32_t> whole = chooseCut(made().nodes, request);
    // The picture's middle.
    request.tile = request.camera;
    for (int column = 0; column < 4; ++column)
      for (int row = 0; row < 2; ++row) request.tile->clip_from_eye[column][row] *= 3.0F;
    const std::vector<std::uint32_t> part = chooseCut(made().nodes, request);
    for (const std::uint32_t node : part) EXPECT_EQ(std::count(whole.begin(), whole.end(), node), 1);
    fewer += part.size() < whole.size() ? 1 : 0;
  }
  EXPECT_GT(fewer, 50U);
}

TEST(HlodTraverseTest, aCutIsInOrderOfDepth) {
  support::RandomViews views(4, made().header.bounds, 400);
  for (int i = 0; i < 50; ++i) {
    TraverseRequest request;
    request.camera = views.next();
    float before = std::numeric_limits<float>::lowest();
    for (const std::uint32_t node : chooseCut(made().nodes, request)) {
      const glm::vec4 center = request.camera.eye_from_scene * glm::vec4(made().nodes[node].box.center(), 1.0F);
      EXPECT_GE(-center.z, before);
      before = -center.z;
    }
  }
}

TEST(HlodTraverseTest, aCameraOfNumbersThatAreNoneGetsTheLeaves) {
  TraverseRequest request;
  request.camera.clip_from_eye[1][1] = std::numeric_limits<float>::quiet_NaN();
  request.cull = false;
  const auto cut = chooseCut(made().nodes, request);
  EXPECT_EQ(cut.size(), 256U);
  for (const std::uint32_t node : cut) EXPECT_TRUE(made().nodes[node].isLeaf());
  EXPECT_TRUE(chooseCut({}, request).empty());
}

}  // namespace
}  // namespace lod::hlod
