#include "plan/point_choice.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <tuple>

#include "repository/sampling/cube_face.h"
#include "tests/support/sample_points.h"

namespace plan {
namespace {

// Returns a view from above onto a wall z = 0. The grid has 17³ points one unit apart, over [−8, 8]² and z from 0.4 up.
PointQuery wallQuery(const glm::vec3& eye) {
  PointQuery query;
  query.grid.first = glm::vec3(-8.0F, -8.0F, 0.4F);
  query.grid.spacing = 1.0F;
  query.grid.count = glm::uvec3(17, 17, 17);
  query.grid.face_size = 512;
  query.eye = eye;
  query.pixels_per_unit_at_one = 900.0F;
  query.error_px = 2.0F;
  query.max_points = 8;
  return query;
}

std::vector<SurfaceSample> wallSamples(float half = 3.0F) {
  std::vector<SurfaceSample> samples;
  for (int i = 0; i < 12; ++i)
    for (int j = 0; j < 12; ++j)
      samples.push_back(
          {glm::vec3(half * (static_cast<float>(i) / 5.5F - 1.0F), half * (static_cast<float>(j) / 5.5F - 1.0F), 0.0F),
           glm::vec3(0.0F, 0.0F, 1.0F), 1.0F / 144.0F});
  return samples;
}

glm::vec3 place(const PointQuery& query, const glm::uvec3& p) {
  return query.grid.point(p.x, p.y, p.z);
}

std::set<std::tuple<std::uint32_t, std::uint32_t, std::uint32_t>> asSet(const std::vector<glm::uvec3>& points) {
  std::set<std::tuple<std::uint32_t, std::uint32_t, std::uint32_t>> set;
  for (const auto& p : points) set.insert({p.x, p.y, p.z});
  return set;
}

// ---- use ----

TEST(PointChoice, useIsOneAtTheEyeWhereAFaceIsAsFine) {
  PointQuery query = wallQuery({0.0F, 0.0F, 5.0F});
  query.pixels_per_unit_at_one = 256.0F;  // a face of 512 over 90°
  EXPECT_NEAR(useOfPoint(query, query.eye, {{0.5F, 0.2F, 0.0F}, {0.0F, 0.0F, 1.0F}, 1.0F}), 1.0F, 1e-5F);
}

TEST(PointChoice, useEqualsAWorkedExample) {
  // The eye is 8 above the sample, the point 4 above and 3 beside it: distance 5, cosine 4/5, tangent 3/4.
  PointQuery query = wallQuery({0.0F, 0.0F, 8.0F});
  const SurfaceSample sample{{0.0F, 0.0F, 0.0F}, {0.0F, 0.0F, 1.0F}, 1.0F};
  const float covers = (900.0F / 8.0F) / (256.0F / 5.0F);
  const float shift = plan::kTypicalError * query.error_px * 0.75F;
  EXPECT_NEAR(useOfPoint(query, {3.0F, 0.0F, 4.0F}, sample), 0.8F / std::sqrt(covers * covers + shift * shift), 1e-5F);
}

TEST(PointChoice, useFallsWithAngleAndDistance) {
  const PointQuery query = wallQuery({0.0F, 0.0F, 8.0F});
  const SurfaceSample sample{{0.0F, 0.0F, 0.0F}, {0.0F, 0.0F, 1.0F}, 1.0F};
  EXPECT_GT(useOfPoint(query, {0.0F, 0.0F, 3.0F}, sample), useOfPoint(query, {0.0F, 0.0F, 7.0F}, sample));
  EXPECT_GT(useOfPoint(query, {0.0F, 0.0F, 7.0F}, sample), useOfPoint(query, {0.0F, 0.0F, 14.0F}, sample));
  EXPECT_GT(useOfPoint(query, {0.5F, 0.0F, 4.0F}, sample), useOfPoint(query, {2.0F, 0.0F, 4.0F}, sample));
}

TEST(PointChoice, pointsBehindTheSurfaceAreOfNoUse) {
  const PointQuery query = wallQuery({0.0F, 0.0F, 8.0F});
  const glm::vec3 up(0.0F, 0.0F, 1.0F);
  EXPECT_EQ(useOfPoint(query, {0.0F, 0.0F, -2.0F}, {{0.0F, 0.0F, 0.0F}, up, 1.0F}), 0.0F);
  EXPECT_EQ(useOfPoint(query, {6.0F, 0.0F, -0.1F}, {{0.0F, 0.0F, 0.0F}, up, 1.0F}), 0.0F);
  // In an open scan seen from behind, the side that the eye sees counts.
  EXPECT_GT(useOfPoint(query, {0.0F, 0.0F, 4.0F}, {{0.0F, 0.0F, 0.0F}, -up, 1.0F}), 0.0F);
  EXPECT_GT(useOfPoint(query, {0.0F, 0.0F, 4.0F}, {{0.0F, 0.0F, 0.0F}, glm::vec3(0.0F), 1.0F}), 0.0F);
}

TEST(PointChoice, useIsFiniteWhereverPointAndEyeAre) {
  for (const glm::vec3& eye : {glm::vec3(0.0F), glm::vec3(0.0F, 0.0F, 1e12F), glm::vec3(1e-20F)}) {
    const PointQuery query = wallQuery(eye);
    for (const glm::vec3& point : {glm::vec3(0.0F), eye, glm::vec3(3.0F)}) {
      const float use = useOfPoint(query, point, {{0.0F, 0.0F, 0.0F}, {0.0F, 0.0F, 1.0F}, 1.0F});
      EXPECT_TRUE(use >= 0.0F && use <= 1.0F) << use;
    }
  }
}

// ---- points ----

TEST(PointChoice, aFarEyeGetsPointsNearTheSurface) {
  const PointQuery query = wallQuery({0.1F, 0.2F, 15.0F});
  const auto points = choosePoints(query, wallSamples());
  ASSERT_EQ(points.size(), 8U);
  // The eye's cell begins at z = 14.4; a face is as fine as the view within 15 · 256 / 900 = 4.3 of the wall.
  const auto nearer =
      std::count_if(points.begin(), points.end(), [&](const glm::uvec3& p) { return place(query, p).z < 9.0F; });
  EXPECT_GE(nearer, 3);
  EXPECT_LT(place(query, points[0]).z, 12.0F) << "and the most useful one comes first";
}

// ---- occlusion ----

/// Returns the wall, and a roof at z = 2.2 above the half of it where x < 0.
lod::patch::ProxySight roofedWall(float error = 0.2F) {
  lod::patch::Hierarchy hierarchy;
  hierarchy.lattice = {glm::dvec3(0.0), 0.1};
  const auto square = [](int x0, int x1, int z) {
    lod::patch::PatchGeometry g;
    g.positions = {{x0, -80, z}, {x1, -80, z}, {x1, 80, z}, {x0, 80, z}};
    g.indices = {0, 1, 2, 0, 2, 3};
    return g;
  };
  const std::vector<std::uint32_t> patches{0, 1};
  auto sight = lod::patch::ProxySight::ofPatches(hierarchy, patches, error, [&](std::uint32_t patch) {
    return base::Result<lod::patch::PatchGeometry>(patch == 0 ? square(-80, 80, 0) : square(-80, 0, 22));
  });
  return *sight;
}

TEST(PointChoice, onlyPointsUnderTheRoofSeeTheWallThere) {
  const lod::patch::ProxySight sight = roofedWall();
  PointQuery query = wallQuery({3.0F, 0.0F, 6.0F});
  const SurfaceSample under{glm::vec3(-3.0F, 0.0F, 0.0F), glm::vec3(0.0F, 0.0F, 1.0F), 1.0F};
  const SurfaceSample open{glm::vec3(3.0F, 0.0F, 0.0F), glm::vec3(0.0F, 0.0F, 1.0F), 1.0F};
  EXPECT_TRUE(isInSight(query, {-3.0F, 0.0F, 8.4F}, under)) << "without a sight nothing is hidden";
  query.sight = &sight;
  EXPECT_FALSE(isInSight(query, {-3.0F, 0.0F, 8.4F}, under));
  EXPECT_TRUE(isInSight(query, {-3.0F, 0.0F, 1.4F}, under));
  EXPECT_TRUE(isInSight(query, {3.0F, 0.0F, 8.4F}, open));
  // The test ignores surfaces within half the proxy's error of the point.
  EXPECT_TRUE(isInSight(query, {-3.0F, 0.0F, 2.25F}, under));
  EXPECT_FALSE(isInSight(query, {-3.0F, 0.0F, 2.35F}, under));
}

TEST(PointChoice, pointsThatSeeNothingAreNotChosen) {
  const lod::patch::ProxySight sight = roofedWall();
  // The eye stands beside the roof and looks at the wall under it, which only points under or beside the roof see.
  PointQuery query = wallQuery({2.0F, 0.1F, 1.4F});
  std::vector<SurfaceSample> under;
  for (const SurfaceSample& s : wallSamples())
    if (s.position.x < -0.5F) under.push_back(s);
  query.sight = &sight;
  const auto points = choosePoints(query, under);
  ASSERT_FALSE(points.empty());
  const auto sees = [&](const glm::uvec3& p) {
    return std::any_of(under.begin(), under.end(), [&](const SurfaceSample& s) {
      return isInSight(query, place(query, p), s) && useOfPoint(query, place(query, p), s) > 0.0F;
    });
  };
  for (const glm::uvec3& p : points) EXPECT_TRUE(sees(p)) << p.x << " " << p.y << " " << p.z;

  const std::vector<glm::uvec3> above{{4, 8, 5}};  // x = −4, z = 5.4, over the roof
  EXPECT_TRUE(orderFaces(query, above, under).empty());
  query.sight = nullptr;
  EXPECT_FALSE(orderFaces(query, above, under).empty());
}

/// A view from above, from which the roof hides half of the wall.
base::Camera fromAbove() {
  base::ViewCamera view;
  view.position = {0.0, 0.3, 10.0};
  view.direction = {0.0, 0.0, -1.0};
  view.up = {0.0, 1.0, 0.0};
  view.fov_y = 0.9F;
  return base::cameraFromView(view, glm::dvec3(0.0), 0.01F, 100.0F);
}

TEST(PointChoice, aCutOfLeavesDoesNotHideWhatItsOwnRaysMeet) {
  const lod::patch::ProxySight sight = roofedWall(0.0F);
  PointQuery query = wallQuery({0.0F, 0.3F, 10.0F});
  query.sight = &sight;
  for (const float aside : {0.0F, 0.1F, 0.37F}) {
    base::ViewCamera view;
    view.position = {static_cast<double>(aside), 0.3, 10.0};
    view.direction = {0.0, 0.0, -1.0};
    const base::Camera camera = base::cameraFromView(view, glm::dvec3(0.0), 0.01F, 100.0F);
    for (const SurfaceSample& s : sampleVisibleSurface(sight, camera, 31, 17))
      EXPECT_TRUE(isInSight(query, camera.eye, s)) << s.position.x << " " << s.position.y << " " << s.position.z;
  }
}

TEST(PointChoice, raysBeginWhereASectionLeavesSomething) {
  const lod::patch::ProxySight sight = roofedWall();
  base::Camera camera = fromAbove();
  const auto heights = [&] {
    std::set<float> met;
    for (const SurfaceSample& s : sampleVisibleSurface(sight, camera, 16, 9))
      met.insert(std::round(10.0F * s.position.z));
    return met;
  };
  camera.section = {0.0F, 0.0F, 1.0F, 2.0F};
  EXPECT_EQ(heights(), (std::set<float>{0.0F})) << "the roof is cut away";
  camera.section = {0.0F, 0.0F, 1.0F, 2.5F};
  EXPECT_EQ(heights(), (std::set<float>{0.0F, 22.0F}));
  camera.section = {0.0F, 0.0F, -1.0F, -2.0F};
  EXPECT_EQ(heights(), (std::set<float>{22.0F})) << "what lies below is cut away";
  camera.section = {0.0F, 0.0F, 1.0F, -1.0F};
  EXPECT_TRUE(heights().empty());
  camera.section = {1.0F, 0.0F, 0.0F, -20.0F};
  EXPECT_TRUE(heights().empty());
}

TEST(PointChoice, pointsUnderACutRoofAreChosen) {
  const lod::patch::ProxySight sight = roofedWall();
  PointQuery query = wallQuery({-3.0F, 0.3F, 30.0F});
  query.sight = &sight;
  std::vector<SurfaceSample> under;
  for (const SurfaceSample& s : wallSamples())
    if (s.position.x < -0.5F) under.push_back(s);
  EXPECT_TRUE(choosePoints(query, under).empty()) << "the grid's points between the eye and the wall lie over the roof";
  query.section = {0.0F, 0.0F, 1.0F, 2.0F};
  const auto points = choosePoints(query, under);
  ASSERT_FALSE(points.empty());
  for (const glm::uvec3& p : points) EXPECT_LT(place(query, p).z, 2.2F);
}

TEST(PointChoice, raysHitTheCoarseCut) {
  const lod::patch::ProxySight sight = roofedWall();
  const auto samples = sampleVisibleSurface(sight, fromAbove(), 16, 9);
  ASSERT_FALSE(samples.empty());
  float weights = 0.0F;
  bool wall = false, roof = false;
  for (const SurfaceSample& s : samples) {
    (s.position.x < 0.0F ? roof : wall) = true;
    EXPECT_NEAR(s.position.z, s.position.x < 0.0F ? 2.2F : 0.0F, 1e-4F);
    EXPECT_NEAR(s.normal.z, 1.0F, 1e-6F);
    weights += s.weight;
  }
  EXPECT_TRUE(wall && roof);
  EXPECT_LE(weights, 1.0001F);
}

TEST(PointChoice, theOrderOfSamplesDoesNotMatter) {
  const PointQuery query = wallQuery({1.3F, -2.2F, 9.0F});
  auto samples = wallSamples();
  const auto points = choosePoints(query, samples);
  const auto faces = orderFaces(query, points, samples);
  std::mt19937 random(1);
  for (int round = 0; round < 5; ++round) {
    std::shuffle(samples.begin(), samples.end(), random);
    EXPECT_EQ(choosePoints(query, samples), points);
    EXPECT_EQ(orderFaces(query, points, samples), faces);
  }
}

TEST(PointChoice, choosesAtMostMaxPoints) {
  PointQuery query = wallQuery({0.0F, 0.0F, 5.0F});
  for (std::size_t max_points : {0U, 1U, 3U, 8U, 64U}) {
    query.max_points = max_points;
    const auto points = choosePoints(query, wallSamples());
    EXPECT_LE(points.size(), max_points);
    EXPECT_EQ(asSet(points).size(), points.size());
    EXPECT_EQ(points.empty(), max_points == 0);
  }
}

TEST(PointChoice, withoutSamplesOrGridNothingIsChosen) {
  PointQuery query = wallQuery({0.0F, 0.0F, 5.0F});
  EXPECT_TRUE(choosePoints(query, {}).empty());
  query.grid = {};
  EXPECT_TRUE(choosePoints(query, wallSamples()).empty());
}

/// The smear in view pixels with which an image taken at `point` shows the wall z = 0 at `target`, found by following
/// rays and not by the formula that chooses points. One pixel of the image covers several of the view. The proxy lies
/// `offset` units above the wall, so the view's ray meets it beside the target, and the image shows there another place
/// of the wall.
double smearOfImage(const PointQuery& query, const glm::dvec3& point, const glm::dvec3& target, double offset) {
  const glm::dvec3 eye(query.eye);
  const double view_pixels_per_unit = query.pixels_per_unit_at_one / glm::length(target - eye);
  const glm::dvec3 to_target = glm::abs(target - point);
  const double depth = std::max({to_target.x, to_target.y, to_target.z});  // along the axis of the face that sees it
  const double covered = 2.0 * depth / query.grid.face_size * view_pixels_per_unit;

  const glm::dvec3 on_proxy = glm::mix(eye, target, (eye.z - offset) / eye.z);
  if (point.z <= offset) return std::numeric_limits<double>::max();
  const glm::dvec3 shown = point + (on_proxy - point) * (point.z / (point.z - offset));
  return std::hypot(std::max(1.0, covered), glm::length(shown - target) * view_pixels_per_unit);
}

/// The mean over the wall of the smear of the sharpest image that one of the points has.
double meanSmear(const PointQuery& query, const std::vector<glm::uvec3>& points, double offset) {
  double sum = 0.0;
  const auto samples = wallSamples();
  for (const SurfaceSample& sample : samples) {
    double sharpest = std::numeric_limits<double>::max();
    for (const glm::uvec3& p : points)
      sharpest =
          std::min(sharpest, smearOfImage(query, glm::dvec3(place(query, p)), glm::dvec3(sample.position), offset));
    sum += sharpest;
  }
  return sum / static_cast<double>(samples.size());
}

TEST(PointChoice, chosenPointsShowTheWallSharperThanTheNearest) {
  for (const glm::vec3& eye : {glm::vec3(0.1F, 0.2F, 15.0F), glm::vec3(1.3F, -2.2F, 12.0F)}) {
    const PointQuery query = wallQuery(eye);
    const auto chosen = choosePoints(query, wallSamples());
    const auto corners = query.grid.cellCorners(query.eye);  // the paper's choice
    // The proxy is off by 2 pixels of the view (error_px), on either side of the wall or not at all.
    const double offset = 2.0 * eye.z / query.pixels_per_unit_at_one;
    for (const double side : {-1.0, 0.0, 1.0}) {
      const double nearest = meanSmear(query, {corners.begin(), corners.end()}, side * offset);
      EXPECT_LT(meanSmear(query, chosen, side * offset), 0.75 * nearest) << nearest << " with the nearest points";
    }
  }
}

// ---- faces ----

TEST(PointChoice, facesAreExactlyThoseThatSeeSamples) {
  const PointQuery query = wallQuery({0.0F, 0.0F, 9.0F});
  const auto samples = wallSamples();
  const auto points = choosePoints(query, samples);
  const auto faces = orderFaces(query, points, samples);
  ASSERT_FALSE(faces.empty());
  std::set<std::uint64_t> listed;
  for (const auto& key : faces) EXPECT_TRUE(listed.insert(key.code()).second);
  for (const auto& p : points) {
    for (std::uint32_t d = 0; d < 6; ++d) {
      const bool sees = std::any_of(samples.begin(), samples.end(), [&](const SurfaceSample& s) {
        return repository::faceOfDirection(s.position - place(query, p)) == d &&
               useOfPoint(query, place(query, p), s) > 0.0F;
      });
      EXPECT_EQ(listed.count(repository::FaceKey{p.x, p.y, p.z, d}.code()) != 0, sees);
      if (d == 4) {
        EXPECT_FALSE(sees) << "nothing is above";
      }
    }
  }
}

// ---- samples ----

TEST(PointChoice, raysFindTheNearestPatch) {
  // Two square patches face up, one above the other, and a third lies beside the view.
  lod::patch::Hierarchy h;
  for (const auto& [x, z] : {std::pair(0.0F, 0.0F), std::pair(0.0F, -3.0F), std::pair(50.0F, 0.0F)}) {
    lod::patch::Patch patch;
    patch.box.add(glm::vec3(x - 2.0F, -2.0F, z - 0.1F));
    patch.box.add(glm::vec3(x + 2.0F, 2.0F, z + 0.1F));
    patch.bounds = {patch.box.center(), 2.9F};
    patch.cone = {glm::vec3(0.0F, 0.0F, 1.0F), 0.99F};
    h.patches.push_back(patch);
  }
  base::ViewCamera view;
  view.position = {0.0, 0.0, 10.0};
  view.width = 160;
  view.height = 90;
  const auto camera = base::cameraFromView(view, glm::dvec3(0.0), 0.1F, 100.0F);
  const auto samples = sampleVisibleSurface(h, std::vector<std::uint32_t>{0, 1, 2}, camera);
  ASSERT_FALSE(samples.empty());
  // At distance 10 the picture is 14.7 × 8.3 units large, of which the square of 4 units is an eighth, so the rays go
  // to it and to a tile around it. The upper patch hides the lower one.
  EXPECT_GT(samples.size(), 50U);
  float weights = 0.0F;
  for (const auto& s : samples) {
    EXPECT_NEAR(s.position.z, 0.0F, 1e-3F);
    EXPECT_LE(std::max(std::abs(s.position.x), std::abs(s.position.y)), 2.0F);
    EXPECT_EQ(s.normal, glm::vec3(0.0F, 0.0F, 1.0F));
    weights += s.weight;
  }
  EXPECT_NEAR(weights, 0.131F, 0.02F) << "its share of the picture";
  EXPECT_TRUE(sampleVisibleSurface(h, {}, camera).empty());
}

/// A flat site of 100 × 100 × 2 units, seen from aside: between the rays through all of the picture.
TEST(PointChoice, raysGoToWhereASmallModelIs) {
  lod::patch::Hierarchy h;
  lod::patch::Patch site;
  site.box.add(glm::vec3(-50.0F, -50.0F, -1.0F));
  site.box.add(glm::vec3(50.0F, 50.0F, 1.0F));
  site.bounds = {glm::vec3(0.0F), 71.0F};
  h.patches.push_back(site);
  base::ViewCamera view;
  view.position = {0.0, -300.0, 0.0};
  view.direction = glm::normalize(glm::dvec3(0.0, 1.0, 0.05));
  view.up = {0.0, 0.0, 1.0};
  view.width = 1280;
  view.height = 720;
  const auto samples = sampleVisibleSurface(h, std::vector<std::uint32_t>{0},
                                            base::cameraFromView(view, glm::dvec3(0.0), 0.1F, 1000.0F));
  EXPECT_GT(samples.size(), 60U);
  float weights = 0.0F;
  for (const SurfaceSample& s : samples) weights += s.weight;
  EXPECT_LT(weights, 0.02F);
  // It turns out of the picture.
  view.direction = {1.0, 0.0, 0.0};
  EXPECT_TRUE(
      sampleVisibleSurface(h, std::vector<std::uint32_t>{0}, base::cameraFromView(view, glm::dvec3(0.0), 0.1F, 1000.0F))
          .empty());
}

TEST(PointChoice, aPatchWithoutMeanNormalIsHitHalfWay) {
  lod::patch::Hierarchy h;
  lod::patch::Patch ball;
  ball.box.add(glm::vec3(-2.0F));
  ball.box.add(glm::vec3(2.0F));
  ball.bounds = {glm::vec3(0.0F), 2.0F};
  h.patches.push_back(ball);
  base::ViewCamera view;
  view.position = {0.0, 0.0, 10.0};
  const auto camera = base::cameraFromView(view, glm::dvec3(0.0), 0.1F, 100.0F);
  const auto samples = sampleVisibleSurface(h, std::vector<std::uint32_t>{0}, camera, 3, 3);
  ASSERT_FALSE(samples.empty());
  EXPECT_NEAR(samples[samples.size() / 2].position.z, 0.0F, 1e-3F);
  EXPECT_EQ(samples[0].normal, glm::vec3(0.0F));
}

// ---- trees of sampling points ----

TEST(PointChoice, aTreeOfSingleStepsChoosesAsTheGridDoes) {
  PointQuery query = wallQuery({1.3F, -2.2F, 6.1F});
  const auto plain = choosePoints(query, wallSamples());
  const repository::SampleTree tree(query.grid, 1);
  query.tree = &tree;
  EXPECT_EQ(choosePoints(query, wallSamples()), plain);
}

TEST(PointChoice, onlyPointsThatAreSampledAreChosen) {
  PointQuery query = wallQuery({1.3F, -2.2F, 6.1F});
  repository::SampleTree tree(query.grid, 8);
  for (const auto& cell : tree.openLeaves())
    if (cell.corner.z == 0) tree.split(cell);
  const glm::uvec3 eye_cell = query.grid.cellOf(query.eye);
  const auto nearest = tree.cornersOf(tree.leafOf(eye_cell));
  tree.leaveOut(nearest[0]);
  query.tree = &tree;
  const auto points = choosePoints(query, wallSamples());
  EXPECT_EQ(points.size(), 8U);
  for (const glm::uvec3& p : points)
    EXPECT_TRUE(support::hasPoint(tree, query.grid, p)) << p.x << " " << p.y << " " << p.z;
  EXPECT_EQ(asSet(points).size(), points.size());
}

}  // namespace
}  // namespace plan
