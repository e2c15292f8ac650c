#include "lod/patch/traverse.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>

#include "tests/support/synthetic_hierarchy.h"

namespace lod::patch {
namespace {

using support::SyntheticHierarchy;

constexpr float kFovY = 0.9F;

// Returns a request for a view from `from` to the square's place `at`.
CutRequest requestFrom(const glm::dvec3& from, const glm::dvec3& at) {
  base::ViewCamera view;
  view.position = from;
  view.direction = glm::normalize(at - from);
  view.up = {0.0, 1.0, 0.001};
  view.fov_y = kFovY;
  CutRequest request;
  request.camera = base::cameraFromView(view, glm::dvec3(0.0), 0.01F, 1000.0F);
  return request;
}

// A view low over one corner, where near groups have large projected errors and far ones small.
CutRequest cornerRequest() {
  CutRequest request = requestFrom({1.0, -6.0, 5.0}, {12.0, 16.0, 0.0});
  request.cull = false;
  return request;
}

// How many patches of the cut cover each unit of the square.
std::vector<int> coverage(const SyntheticHierarchy& scene, const std::vector<std::uint32_t>& patches) {
  std::vector<int> counts(static_cast<std::size_t>(scene.side * scene.side), 0);
  for (const std::uint32_t p : patches)
    for (int y = scene.regions[p].y0; y < scene.regions[p].y1; ++y)
      for (int x = scene.regions[p].x0; x < scene.regions[p].x1; ++x)
        ++counts[static_cast<std::size_t>(y * scene.side + x)];
  return counts;
}

bool coversOnce(const SyntheticHierarchy& scene, const std::vector<std::uint32_t>& patches) {
  const auto counts = coverage(scene, patches);
  return std::all_of(counts.begin(), counts.end(), [](int count) { return count == 1; });
}

// Edges within the square that have no opposite.
int openEdges(const SyntheticHierarchy& scene, const std::vector<std::uint32_t>& patches) {
  using Point = std::array<int, 3>;
  std::map<std::pair<Point, Point>, int> edges;
  for (const std::uint32_t p : patches) {
    const PatchGeometry& g = scene.geometry[p];
    const auto point = [&](std::size_t i) {
      return Point{g.positions[g.indices[i]].x, g.positions[g.indices[i]].y, g.positions[g.indices[i]].z};
    };
    for (std::size_t t = 0; t < g.indices.size(); t += 3)
      for (std::size_t k = 0; k < 3; ++k) ++edges[{point(t + k), point(t + (k + 1) % 3)}];
  }
  const int far = scene.side * support::synthetic::kLatticePerUnit;
  const auto along = [&](const Point& a, const Point& b, std::size_t axis, int where) {
    return a[axis] == where && b[axis] == where;
  };
  int open = 0;
  for (const auto& [edge, count] : edges) {
    const auto& [a, b] = edge;
    const bool rim = along(a, b, 0, 0) || along(a, b, 0, far) || along(a, b, 1, 0) || along(a, b, 1, far);
    const auto other = edges.find({b, a});
    if (!rim && (other == edges.end() || other->second != count)) ++open;
  }
  return open;
}

// The largest projected error above which a group lies, computed from the definition.
float projected(const Hierarchy& h, std::uint32_t g, const CutRequest& r) {
  const Group& group = h.groups[g];
  const float distance = std::max(glm::length(group.bounds.center - r.camera.eye) - group.bounds.radius, r.near_plane);
  return group.error * static_cast<float>(r.camera.height) / (2.0F * std::tan(kFovY / 2.0F) * distance);
}

std::uint64_t trianglesOf(const Hierarchy& h, const std::vector<std::uint32_t>& patches) {
  std::uint64_t sum = 0;
  for (const std::uint32_t p : patches) sum += h.patches[p].triangles;
  return sum;
}

const SyntheticHierarchy& scene() {
  static const SyntheticHierarchy made = support::syntheticHierarchy(16);
  return made;
}

TEST(SyntheticHierarchy, isSoundAndADagWithSeveralParents) {
  for (const int n : {4, 8, 16}) {
    const auto made = support::syntheticHierarchy(n);
    const auto sound = checkHierarchy(made.hierarchy);
    EXPECT_TRUE(sound) << sound.error().message;
    EXPECT_TRUE(std::any_of(made.hierarchy.groups.begin(), made.hierarchy.groups.end(),
                            [](const Group& g) { return g.parent_count > 1; }));
  }
}

TEST(SyntheticHierarchy, mixingLevelsWithoutTheRuleOpensEdges) {
  // The leaves of one group in place of one coarse child of the root leave borders that do not match.
  const Hierarchy& h = scene().hierarchy;
  Cut cut = selectUniformCut(h, h.groups[1].error * 0.99F);
  ASSERT_EQ(openEdges(scene(), cut.patches), 0);
  cut.patches.erase(cut.patches.begin());
  EXPECT_GT(openEdges(scene(), cut.patches), 0);
  const Cut leaves = selectUniformCut(h, 0.0F);
  const auto region = scene().regions[leaves.patches[0]];
  std::vector<std::uint32_t> mixed{leaves.patches[0]};
  for (const std::uint32_t p : selectUniformCut(h, h.groups[1].error * 0.99F).patches)
    if (!support::synthetic::inside(region, scene().regions[p])) mixed.push_back(p);
  EXPECT_GT(openEdges(scene(), mixed), 0);
}

TEST(SelectCut, toleranceZeroGivesTheLeavesAndAHugeOneTheRoot) {
  CutRequest request = cornerRequest();
  request.tolerance_px = 0.0F;
  const Cut leaves = selectCut(scene().hierarchy, request);
  EXPECT_EQ(leaves.patches.size(), 256U);
  EXPECT_EQ(leaves.triangles, scene().hierarchy.source_triangles);
  EXPECT_EQ(leaves.error_px, 0.0F);
  EXPECT_EQ(leaves.expanded.size(), scene().hierarchy.groups.size());

  request.tolerance_px = 1e9F;
  const Cut root = selectCut(scene().hierarchy, request);
  EXPECT_EQ(root.patches, std::vector<std::uint32_t>{0});
  EXPECT_EQ(root.expanded, std::vector<std::uint32_t>{0});
  EXPECT_FLOAT_EQ(root.error_px, projected(scene().hierarchy, 1, request));
}

TEST(SelectCut, anErrorOfZeroIsStillRefinedAtToleranceZero) {
  SyntheticHierarchy flat = support::syntheticHierarchy(4);
  for (std::size_t g = 1; g < flat.hierarchy.groups.size(); ++g) flat.hierarchy.groups[g].visible_error = 0.0F;
  CutRequest request = cornerRequest();
  request.tolerance_px = 0.0F;
  EXPECT_EQ(selectCut(flat.hierarchy, request).patches.size(), 16U);
  request.tolerance_px = 1e-6F;
  EXPECT_EQ(selectCut(flat.hierarchy, request).patches.size(), 1U);
}

TEST(SelectCut, goesByTheVisibleErrorUnlessTheBoundIsAskedFor) {
  SyntheticHierarchy rough = support::syntheticHierarchy(8);
  for (std::size_t g = 1; g < rough.hierarchy.groups.size(); ++g) rough.hierarchy.groups[g].visible_error /= 8.0F;
  CutRequest request = cornerRequest();
  request.tolerance_px = 2.0F;
  const Cut visible = selectCut(rough.hierarchy, request);
  request.measure = base::ErrorMeasure::kBound;
  const Cut bound = selectCut(rough.hierarchy, request);
  EXPECT_LT(visible.triangles, bound.triangles);
  EXPECT_LE(visible.error_px, 2.0F);
  EXPECT_LE(bound.error_px, 2.0F);
  // An eighth of the error allows eight times the tolerance.
  request.tolerance_px = 16.0F;
  const Cut coarse = selectCut(rough.hierarchy, request);
  EXPECT_EQ(visible.patches, coarse.patches);
  EXPECT_FLOAT_EQ(8.0F * visible.error_px, coarse.error_px);
}

TEST(SelectCut, everyToleranceCoversTheSquareOnceWithoutOpenEdges) {
  std::set<std::size_t> sizes;
  for (float tolerance = 0.25F; tolerance < 100.0F; tolerance *= 1.1F) {
    CutRequest request = cornerRequest();
    request.tolerance_px = tolerance;
    const Cut cut = selectCut(scene().hierarchy, request);
    EXPECT_TRUE(coversOnce(scene(), cut.patches)) << tolerance;
    EXPECT_EQ(openEdges(scene(), cut.patches), 0) << tolerance;
    EXPECT_LE(cut.error_px, tolerance);
    EXPECT_EQ(cut.triangles, trianglesOf(scene().hierarchy, cut.patches));
    sizes.insert(cut.patches.size());
  }
  EXPECT_GT(sizes.size(), 20U) << "the tolerances must pass through many different cuts";
}

TEST(SelectCut, aFinerToleranceExpandsAllThatACoarserOneDoes) {
  std::vector<std::uint32_t> coarser;
  for (float tolerance = 100.0F; tolerance > 0.25F; tolerance *= 0.9F) {
    CutRequest request = cornerRequest();
    request.tolerance_px = tolerance;
    std::vector<std::uint32_t> expanded = selectCut(scene().hierarchy, request).expanded;
    std::sort(expanded.begin(), expanded.end());
    EXPECT_TRUE(std::includes(expanded.begin(), expanded.end(), coarser.begin(), coarser.end()));
    coarser = expanded;
  }
}

TEST(SelectCut, expandsExactlyTheGroupsAboveTheTolerance) {
  const Hierarchy& h = scene().hierarchy;
  CutRequest request = cornerRequest();
  request.tolerance_px = 1.0F;
  const Cut cut = selectCut(h, request);
  std::set<std::uint32_t> expanded(cut.expanded.begin(), cut.expanded.end());
  ASSERT_EQ(expanded.size(), cut.expanded.size());
  std::set<std::uint32_t> expected{0};
  for (std::uint32_t g = 1; g < h.groups.size(); ++g)
    if (projected(h, g, request) > 1.0F) expected.insert(g);
  EXPECT_EQ(expanded, expected);
  EXPECT_GT(expected.size(), 10U);
  EXPECT_LT(expected.size(), h.groups.size() - 10);
}

TEST(SelectCut, expandedListsParentsBeforeChildren) {
  const Hierarchy& h = scene().hierarchy;
  CutRequest request = cornerRequest();
  request.tolerance_px = 0.0F;
  const Cut cut = selectCut(h, request);
  std::set<std::uint32_t> before;
  for (const std::uint32_t g : cut.expanded) {
    for (const std::uint32_t parent : h.parentsOf(g)) EXPECT_TRUE(before.contains(parent));
    before.insert(g);
  }
}

TEST(SelectCut, staysWatertightWhateverIsMissing) {
  std::mt19937 random(5);
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<bool> here(scene().hierarchy.groups.size());
    std::bernoulli_distribution present(0.5 + 0.5 * (trial % 10) / 10.0);
    for (std::size_t g = 0; g < here.size(); ++g) here[g] = g < 2 || present(random);
    CutRequest request = cornerRequest();
    request.tolerance_px = 0.5F;
    const Cut cut = selectCut(scene().hierarchy, request, [&](std::uint32_t g) { return here[g]; });
    EXPECT_TRUE(coversOnce(scene(), cut.patches));
    EXPECT_EQ(openEdges(scene(), cut.patches), 0);
    for (const std::uint32_t g : cut.expanded) EXPECT_TRUE(here[g]);
  }
}

TEST(SelectCut, budgetIsKeptAndSpentOnTheLargestErrors) {
  const Hierarchy& h = scene().hierarchy;
  CutRequest request = cornerRequest();
  request.tolerance_px = 0.0F;
  std::uint64_t last = 0;
  for (std::uint64_t budget = 300; budget < 4200; budget += 100) {
    request.max_triangles = budget;
    const Cut cut = selectCut(h, request);
    EXPECT_LE(cut.triangles, budget);
    EXPECT_GE(cut.triangles, last) << "more budget, more triangles";
    EXPECT_TRUE(coversOnce(scene(), cut.patches));
    EXPECT_EQ(openEdges(scene(), cut.patches), 0);
    last = cut.triangles;

    // No group that could have been expanded has a larger error than those that were.
    const std::set<std::uint32_t> expanded(cut.expanded.begin(), cut.expanded.end());
    float least = std::numeric_limits<float>::max();
    for (const std::uint32_t g : cut.expanded) least = std::min(least, projected(h, g, request));
    for (std::uint32_t g = 0; g < h.groups.size(); ++g) {
      const auto parents = h.parentsOf(g);
      const bool next = !expanded.contains(g) && std::all_of(parents.begin(), parents.end(),
                                                             [&](std::uint32_t p) { return expanded.contains(p); });
      if (next) {
        EXPECT_LE(projected(h, g, request), least * 1.0001F);
      }
    }
  }
  EXPECT_GT(last, 3000U);
}

TEST(SelectCut, theRootIsDrawnWhateverTheBudget) {
  CutRequest request = cornerRequest();
  request.max_triangles = 1;
  EXPECT_EQ(selectCut(scene().hierarchy, request).patches, std::vector<std::uint32_t>{0});
}

TEST(SelectCut, wantedIsWhatIsMissingNextLargestFirst) {
  const Hierarchy& h = scene().hierarchy;
  CutRequest request = cornerRequest();
  request.tolerance_px = 1.0F;
  std::vector<bool> here(h.groups.size(), true);
  for (std::uint32_t g = 8; g < h.groups.size(); g += 3) here[g] = false;
  const Cut cut = selectCut(h, request, [&](std::uint32_t g) { return here[g]; });
  const std::set<std::uint32_t> expanded(cut.expanded.begin(), cut.expanded.end());

  std::set<std::uint32_t> expected;
  for (std::uint32_t g = 1; g < h.groups.size(); ++g) {
    const auto parents = h.parentsOf(g);
    const bool next =
        std::all_of(parents.begin(), parents.end(), [&](std::uint32_t p) { return expanded.contains(p); });
    if (!here[g] && next && projected(h, g, request) > 1.0F) expected.insert(g);
  }
  EXPECT_GT(expected.size(), 3U);
  EXPECT_EQ(std::set<std::uint32_t>(cut.wanted.begin(), cut.wanted.end()), expected);
  for (std::size_t i = 1; i < cut.wanted.size(); ++i)
    EXPECT_LE(projected(h, cut.wanted[i], request), projected(h, cut.wanted[i - 1], request) + 2e-3F);
}

TEST(SelectCut, fetchingTheMostWantedUntilNothingIsLeadsToTheFullCut) {
  const Hierarchy& h = scene().hierarchy;
  CutRequest request = cornerRequest();
  request.tolerance_px = 2.0F;
  std::vector<bool> here(h.groups.size(), false);
  Cut cut = selectCut(h, request, [&](std::uint32_t g) { return here[g]; });
  EXPECT_TRUE(cut.patches.empty());
  EXPECT_EQ(cut.wanted, std::vector<std::uint32_t>{0});
  for (std::size_t step = 0; step < h.groups.size() && !cut.wanted.empty(); ++step) {
    here[cut.wanted.front()] = true;
    cut = selectCut(h, request, [&](std::uint32_t g) { return here[g]; });
    EXPECT_EQ(openEdges(scene(), cut.patches), 0);
  }
  const Cut full = selectCut(h, request);
  EXPECT_TRUE(cut.wanted.empty());
  EXPECT_EQ(cut.patches, full.patches);
  EXPECT_EQ(cut.error_px, full.error_px);
}

TEST(SelectCut, neitherRefinesNorDrawsOutsideTheFrustum) {
  const Hierarchy& h = scene().hierarchy;
  CutRequest request = requestFrom({8.0, 8.0, 6.0}, {8.0, 8.5, 0.0});
  request.tolerance_px = 0.0F;
  const Cut culled = selectCut(h, request);
  const base::Frustum frustum(request.camera.clipFromScene());
  request.cull = false;
  const Cut whole = selectCut(h, request);

  EXPECT_LT(culled.triangles, whole.triangles / 2);
  EXPECT_EQ(culled.triangles, trianglesOf(h, culled.patches));
  for (const std::uint32_t p : culled.patches) EXPECT_TRUE(frustum.mayOverlap(h.patches[p].box));
  for (const std::uint32_t g : culled.expanded) EXPECT_TRUE(frustum.mayOverlap(h.groups[g].bounds));
  // Every leaf in sight is drawn, as a leaf.
  for (const std::uint32_t p : whole.patches)
    if (frustum.mayOverlap(h.patches[p].box)) {
      EXPECT_NE(std::find(culled.patches.begin(), culled.patches.end(), p), culled.patches.end());
    }
}

TEST(SelectCut, neitherRefinesNorDrawsWhatASectionCutsAway) {
  const Hierarchy& h = scene().hierarchy;
  CutRequest request = requestFrom({32.0, 32.0, 50.0}, {32.0, 32.5, 0.0});
  request.tolerance_px = 0.0F;
  request.camera.section = {1.0F, 0.0F, 0.0F, 20.0F};  // what lies at x > 20 goes
  const Cut cut = selectCut(h, request);
  request.camera.section = base::kNoSection;
  const Cut whole = selectCut(h, request);
  EXPECT_LT(cut.triangles, whole.triangles / 2);
  for (const std::uint32_t p : cut.patches) EXPECT_LE(h.patches[p].box.min.x, 20.0F);
  for (const std::uint32_t p : whole.patches)
    if (h.patches[p].box.min.x <= 20.0F) {
      EXPECT_NE(std::find(cut.patches.begin(), cut.patches.end(), p), cut.patches.end());
    }
  request.camera.section = {1.0F, 0.0F, 0.0F, 20.0F};
  request.cull = false;
  EXPECT_EQ(selectCut(h, request).triangles, selectCut(h,
                                                       [&] {
                                                         CutRequest all = request;
                                                         all.camera.section = base::kNoSection;
                                                         return all;
                                                       }())
                                                 .triangles)
      << "without culling all is there";
}

TEST(SelectCut, budgetCountsOnlyWhatIsSeen) {
  CutRequest request = requestFrom({8.0, 8.0, 6.0}, {8.0, 8.5, 0.0});
  request.tolerance_px = 0.0F;
  const Cut all = selectCut(scene().hierarchy, request);
  request.max_triangles = all.triangles;
  const Cut kept = selectCut(scene().hierarchy, request);
  EXPECT_LE(kept.triangles, all.triangles);
  EXPECT_GT(kept.triangles, all.triangles / 2);
}

TEST(SelectCut, lookingAwayDrawsNothing) {
  CutRequest request = requestFrom({32.0, 32.0, 50.0}, {32.0, 32.5, 100.0});
  EXPECT_TRUE(selectCut(scene().hierarchy, request).patches.empty());
}

TEST(SelectCut, backsAreDrawnUnlessTheMeshIsClosed) {
  CutRequest request = requestFrom({32.0, 32.0, -200.0}, {32.0, 32.5, 0.0});
  const Cut open_scan = selectCut(scene().hierarchy, request);
  EXPECT_GT(open_scan.triangles, 0U);
  request.cull_back_faces = true;
  EXPECT_EQ(selectCut(scene().hierarchy, request).triangles, 0U);
}

TEST(SelectCut, insideASphereTheNearPlaneKeepsErrorsFinite) {
  CutRequest request = requestFrom({32.0, 32.0, 0.2}, {33.0, 33.0, 0.0});
  request.near_plane = 0.5F;
  request.cull = false;
  request.tolerance_px = 1e9F;
  const Cut cut = selectCut(scene().hierarchy, request);
  EXPECT_TRUE(std::isfinite(cut.error_px));
  EXPECT_FLOAT_EQ(cut.error_px, projected(scene().hierarchy, 1, request));
}

TEST(SelectCut, aCameraOfNaNStillEnds) {
  CutRequest request = cornerRequest();
  request.camera.eye = glm::vec3(NAN);
  request.camera.eye_from_scene = glm::mat4(NAN);
  for (const float tolerance : {0.0F, 1.0F, NAN}) {
    request.tolerance_px = tolerance;
    request.cull = true;
    const Cut cut = selectCut(scene().hierarchy, request);
    EXPECT_LE(cut.triangles, scene().hierarchy.source_triangles);
  }
}

TEST(SelectCut, aCameraOfNaNWantsGroupsByTheirNumbers) {
  CutRequest request = cornerRequest();
  request.camera.eye = glm::vec3(NAN);
  request.tolerance_px = 0.0F;
  const Cut cut = selectCut(scene().hierarchy, request, [](std::uint32_t g) { return g < 2; });
  ASSERT_GT(cut.wanted.size(), 1U);
  EXPECT_TRUE(std::is_sorted(cut.wanted.begin(), cut.wanted.end()));
}

TEST(SelectCut, anEmptyHierarchyGivesAnEmptyCut) {
  const Cut cut = selectCut({}, cornerRequest());
  EXPECT_TRUE(cut.patches.empty() && cut.expanded.empty() && cut.wanted.empty());
}

TEST(SelectCut, theSameViewGivesTheSameCut) {
  CutRequest request = cornerRequest();
  EXPECT_EQ(selectCut(scene().hierarchy, request).patches, selectCut(scene().hierarchy, request).patches);
}

TEST(SelectUniformCut, isTheCoarsestWithinTheError) {
  const Hierarchy& h = scene().hierarchy;
  std::set<std::size_t> sizes;
  for (float error = 0.005F; error < 0.2F; error *= 1.05F) {
    const Cut cut = selectUniformCut(h, error);
    EXPECT_TRUE(coversOnce(scene(), cut.patches)) << error;
    EXPECT_EQ(openEdges(scene(), cut.patches), 0) << error;
    EXPECT_EQ(cut.triangles, trianglesOf(h, cut.patches));
    for (const std::uint32_t p : cut.patches) {
      if (h.patches[p].producer != kNoGroup) {
        EXPECT_LE(h.groups[h.patches[p].producer].error, error);
      }
      EXPECT_GT(h.groups[h.patches[p].consumer].error, error) << "a coarser patch would have done";
    }
    sizes.insert(cut.patches.size());
  }
  EXPECT_GT(sizes.size(), 5U);
  EXPECT_EQ(selectUniformCut(h, 0.0F).patches.size(), 256U);
  EXPECT_EQ(selectUniformCut(h, std::numeric_limits<float>::infinity()).patches.size(), 1U);
}

// ---- parallel views, costs ----

CutRequest orthoRequest(double height) {
  base::ViewCamera view;
  view.position = {16.0, 16.0, 5.0};
  view.up = {0.0, 1.0, 0.0};
  view.ortho_height = height;
  CutRequest request;
  request.camera = base::cameraForScene(view, glm::dvec3(0.0), {glm::vec3(16.0F, 16.0F, 0.0F), 40.0F});
  request.cull = false;
  return request;
}

TEST(OrthographicCut, isTheUniformCutOfItsScale) {
  const SyntheticHierarchy scene = support::syntheticHierarchy(8);
  for (const float tolerance : {0.5F, 2.0F, 8.0F}) {
    CutRequest request = orthoRequest(32.0);
    request.tolerance_px = tolerance;
    Cut cut = selectCut(scene.hierarchy, request);
    Cut uniform = selectUniformCut(scene.hierarchy, tolerance / request.camera.pixelsPerUnitAtOne());
    std::sort(cut.patches.begin(), cut.patches.end());
    std::sort(uniform.patches.begin(), uniform.patches.end());
    EXPECT_EQ(cut.patches, uniform.patches) << tolerance;
    EXPECT_LE(cut.error_px, tolerance);
    EXPECT_FALSE(cut.limited);
  }
}

TEST(OrthographicCut, leavesOutWhatIsBesideThePicture) {
  const SyntheticHierarchy scene = support::syntheticHierarchy(8);
  CutRequest request = orthoRequest(4.0);
  request.tolerance_px = 0.0F;
  const Cut all = selectCut(scene.hierarchy, request);
  request.cull = true;
  const Cut seen = selectCut(scene.hierarchy, request);
  EXPECT_LT(seen.triangles, all.triangles / 2);
  EXPECT_GT(seen.triangles, 0U);
}

TEST(Cut, saysTheErrorOfEachPatch) {
  const SyntheticHierarchy scene = support::syntheticHierarchy(8);
  CutRequest request = cornerRequest();
  request.tolerance_px = 10.0F;
  const Cut cut = selectCut(scene.hierarchy, request);
  ASSERT_EQ(cut.patch_error_px.size(), cut.patches.size());
  float largest = 0.0F;
  for (std::size_t i = 0; i < cut.patches.size(); ++i) {
    largest = std::max(largest, cut.patch_error_px[i]);
    if (scene.hierarchy.patches[cut.patches[i]].producer == kNoGroup) {
      EXPECT_EQ(cut.patch_error_px[i], 0.0F);
    }
  }
  EXPECT_EQ(largest, cut.error_px);
}

TEST(Cut, staysBelowItsCostAndIsWatertight) {
  const SyntheticHierarchy scene = support::syntheticHierarchy(8);
  CutRequest request = cornerRequest();
  request.tolerance_px = 0.0F;
  request.cost = [](const Patch& patch) { return std::uint64_t{20} * patch.vertices + 6 * patch.triangles; };
  const std::uint64_t all = selectCut(scene.hierarchy, request).cost;
  float error = 0.0F;
  for (const std::uint64_t most : {all, all - 1, all / 2, all / 4, std::uint64_t{1}}) {
    request.max_cost = most;
    const Cut cut = selectCut(scene.hierarchy, request);
    std::uint64_t cost = 0;
    for (const std::uint32_t g : cut.expanded) {
      const Group& group = scene.hierarchy.groups[g];
      for (std::uint32_t i = 0; i < group.patch_count; ++i)
        cost += request.cost(scene.hierarchy.patches[group.first_patch + i]);
    }
    EXPECT_EQ(cut.cost, cost);
    EXPECT_TRUE(cost <= most || cut.expanded.size() == 1) << "group 0 is drawn whatever it costs";
    EXPECT_EQ(cut.limited, most < all);
    EXPECT_TRUE(coversOnce(scene, cut.patches));
    EXPECT_EQ(openEdges(scene, cut.patches), 0);
    EXPECT_GE(cut.error_px, error) << "less room, coarser";
    error = cut.error_px;
  }
}

}  // namespace
}  // namespace lod::patch
