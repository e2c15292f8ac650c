#include "plan/view_plan.h"

#include <gtest/gtest.h>

#include <cmath>

#include "lod/patch/traverse.h"
#include "tests/server/session/memory_store.h"

namespace plan {
namespace {

TEST(ViewPlan, coarseGroupsAreTheTopWithinTheirBytes) {
  const server::TestScene scene(16);
  const lod::patch::Hierarchy& h = scene.patches->hierarchy();
  for (const std::uint64_t budget : {0U, 3'000U, 10'000U, 1'000'000'000U}) {
    const auto coarse = coarseGroups(h, budget);
    ASSERT_FALSE(coarse.empty());
    EXPECT_EQ(coarse[0], 0U);
    std::uint64_t bytes = 0;
    float largest_left = 0.0F;
    std::vector<bool> in(h.groups.size(), false);
    for (std::uint32_t group : coarse) {
      for (std::uint32_t parent : h.parentsOf(group)) EXPECT_TRUE(in[parent]);
      in[group] = true;
      bytes += h.groups[group].block_bytes;
    }
    for (std::size_t g = 0; g < h.groups.size(); ++g)
      if (!in[g]) largest_left = std::max(largest_left, h.groups[g].error);
    for (std::uint32_t group : coarse) EXPECT_GE(h.groups[group].error, largest_left);
    EXPECT_TRUE(coarse.size() == 1 || bytes <= budget);
  }
  EXPECT_EQ(coarseGroups(h, 1'000'000'000).size(), h.groups.size());
}

TEST(ViewPlan, groupsOfLittleGainAreForMovingEyesWithFastLinksAlone) {
  const server::TestScene scene(16);
  // Errors of colour that call for groups of which nothing is gained, as far as typical errors tell.
  lod::patch::Hierarchy colored = scene.patches->hierarchy();
  for (lod::patch::Group& group : colored.groups) group.visible_error *= 30.0F, group.typical_color_error = 0.0F;
  protocol::View view = scene.view(1, {0.1, -0.2, 0.3}, {0.1, 0.1, 0.0});
  view.measure = base::ErrorMeasure::kVisible;
  Scene planned = scene.data.toPlan();
  planned.hierarchy = &colored;
  const auto groups = [&](bool rests, double link_rate) {
    planned.rests = rests;
    planned.link_rate = link_rate;
    return planView(planned, view).groups.size();
  };
  EXPECT_EQ(groups(false, 0.5 * kFastLink), groups(true, 2.0 * kFastLink));
  EXPECT_GT(groups(false, 2.0 * kFastLink), groups(true, 2.0 * kFastLink));
}

// A client that applies the same rule to the groups it received arrives at exactly the cut that the server planned.
TEST(ViewPlan, groupsLeadAClientToTheWholeHierarchysCut) {
  const server::TestScene scene(16);
  const lod::patch::Hierarchy& h = scene.patches->hierarchy();
  for (const std::uint32_t budget : {500U, 2'000U, 1'000'000U}) {
    protocol::View view = scene.view(1, {0.1, -0.2, 0.3}, {0.1, 0.1, 0.0});
    view.max_triangles = budget;
    view.measure = base::ErrorMeasure::kShape;  // by visible errors the last groups would not be worth their bytes
    const ViewPlan plan = planView(scene.data.toPlan(), view);
    std::vector<bool> sent(h.groups.size(), false);
    for (std::uint32_t group : plan.groups) sent[group] = true;

    const base::Sphere bounds{0.5F * (scene.data.welcome.box_min + scene.data.welcome.box_max),
                              0.5F * glm::length(scene.data.welcome.box_max - scene.data.welcome.box_min)};
    lod::patch::CutRequest request;
    request.camera = base::cameraForScene(view.camera, glm::dvec3(0.0), bounds);
    request.near_plane = base::nearestDistance(request.camera.eye, bounds);
    request.tolerance_px = view.patch_tolerance_px;
    request.max_triangles = budget;
    request.measure = view.measure;
    const auto whole = lod::patch::selectCut(h, request);
    const auto partial = lod::patch::selectCut(h, request, [&](std::uint32_t group) { return sent[group]; });
    EXPECT_EQ(partial.patches, whole.patches);
    EXPECT_EQ(partial.expanded.size(), plan.groups.size()) << "nothing was sent in vain";
  }
}

// By visible errors groups may stay that only bring colours, and never those of the shape.
TEST(ViewPlan, whatTheShapeNeedsComesWhateverItGains) {
  const server::TestScene scene(16);
  protocol::View view = scene.view(1, {0.1, -0.2, 0.3}, {0.1, 0.1, 0.0});
  view.measure = base::ErrorMeasure::kShape;
  const ViewPlan shape = planView(scene.data.toPlan(), view);
  view.measure = base::ErrorMeasure::kVisible;
  const ViewPlan visible = planView(scene.data.toPlan(), view);
  view.max_points = 0;
  const ViewPlan without_images = planView(scene.data.toPlan(), view);
  const auto holds = [](const ViewPlan& plan, std::uint32_t group) {
    return std::find(plan.groups.begin(), plan.groups.end(), group) != plan.groups.end();
  };
  for (const std::uint32_t group : shape.groups) EXPECT_TRUE(holds(visible, group)) << group;
  for (const std::uint32_t group : visible.groups) EXPECT_TRUE(holds(without_images, group)) << group;
}

TEST(ViewPlan, onASlowLinkTheShapeDecidesAboutAFreshView) {
  const server::TestScene scene(16);
  Scene planned = scene.data.toPlan();
  protocol::View view = scene.view(1, {0.1, -0.2, 0.3}, {0.1, 0.1, 0.0});
  view.measure = base::ErrorMeasure::kVisible;
  const auto measureOf = [&](bool is_fresh, double link_rate) {
    planned.is_fresh = is_fresh;
    planned.link_rate = link_rate;
    return viewToPlan(planned, view).measure;
  };
  EXPECT_EQ(measureOf(true, 0.0), base::ErrorMeasure::kShape) << "nothing is known of the link";
  EXPECT_EQ(measureOf(true, 0.9 * kFastLink), base::ErrorMeasure::kShape);
  EXPECT_EQ(measureOf(true, kFastLink), base::ErrorMeasure::kVisible);
  EXPECT_EQ(measureOf(false, 0.0), base::ErrorMeasure::kVisible) << "a view at rest is refined on any link";
  view.max_points = 0;
  EXPECT_EQ(measureOf(true, 0.0), base::ErrorMeasure::kVisible) << "nothing else brings colours";
}

TEST(ViewPlan, onASlowLinkColoursComeWithPatchesThatAreSoonWhole) {
  const server::TestScene scene(16);
  Scene planned = scene.data.toPlan();
  planned.is_fresh = true;
  protocol::View view = scene.view(1, {0.1, -0.2, 0.3}, {0.1, 0.1, 0.0});
  view.measure = base::ErrorMeasure::kVisible;
  planned.link_rate = 0.1 * kFastLink;
  planned.patch_bytes = static_cast<std::uint64_t>(kSoonWhole * planned.link_rate);
  EXPECT_EQ(viewToPlan(planned, view).measure, base::ErrorMeasure::kVisible);
  planned.patch_bytes *= 2;
  EXPECT_EQ(viewToPlan(planned, view).measure, base::ErrorMeasure::kShape);
  planned.patch_bytes = 0;
  EXPECT_EQ(viewToPlan(planned, view).measure, base::ErrorMeasure::kShape) << "nothing is known of the patches";
}

TEST(ViewPlan, anEyeIsFastThatTurnsOrGoesFast) {
  base::ViewCamera from;
  from.direction = {0.0, 0.0, -1.0};
  const auto turned = [&](double radians) {
    base::ViewCamera to = from;
    to.direction = {std::sin(radians), 0.0, -std::cos(radians)};
    return to;
  };
  EXPECT_FALSE(isFast(from, turned(0.003), 1.0 / 60.0, 3.0)) << "10 degrees a second";
  EXPECT_TRUE(isFast(from, turned(0.017), 1.0 / 60.0, 3.0)) << "60 degrees a second";
  EXPECT_FALSE(isFast(from, turned(0.017), 0.1, 3.0)) << "10 degrees a second";
  base::ViewCamera moved = from;
  moved.position.x += 0.02;
  EXPECT_TRUE(isFast(from, moved, 1.0 / 60.0, 3.0));
  EXPECT_FALSE(isFast(from, moved, 1.0 / 60.0, 6.0));
  EXPECT_FALSE(isFast(from, moved, 0.0, 3.0)) << "two views at a time tell no speed";
}

TEST(ViewPlan, groupsThatAreHereAreLeftOutAndParentsComeFirst) {
  const server::TestScene scene(16);
  const protocol::View view = scene.view(1, {0.0, 0.0, 0.3});
  const ViewPlan whole = planView(scene.data.toPlan(), view);
  ASSERT_GT(whole.groups.size(), 3U);
  ASSERT_EQ(whole.faces_before.size(), whole.groups.size());
  for (std::size_t held = 0; held <= whole.groups.size(); ++held) {
    std::vector<bool> here(scene.patches->hierarchy().groups.size(), false);
    for (std::size_t i = 0; i < held; ++i) here[whole.groups[i]] = true;
    Holdings present;
    present.group = [&](std::uint32_t group) { return static_cast<bool>(here[group]); };
    const ViewPlan rest = planView(scene.data.toPlan(), view, present);
    EXPECT_EQ(rest.groups.size(), whole.groups.size() - held);
    EXPECT_TRUE(std::is_sorted(rest.faces_before.begin(), rest.faces_before.end()));
    for (const std::uint32_t group : rest.groups) {
      EXPECT_FALSE(here[group]);
      for (const std::uint32_t parent : scene.patches->hierarchy().parentsOf(group)) EXPECT_TRUE(here[parent]);
      here[group] = true;
    }
  }
}

TEST(ViewPlan, facesAndOtherFacesCoverAllPoints) {
  const server::TestScene scene;
  protocol::View view = scene.view(1, {0.3, 0.3, 0.6});
  view.max_points = 5;
  const ViewPlan plan = planView(scene.data.toPlan(), view);
  std::set<std::tuple<std::uint32_t, std::uint32_t, std::uint32_t>> points;
  std::set<std::uint64_t> keys;
  for (const auto* list : {&plan.faces, &plan.other_faces})
    for (const auto& key : *list) {
      EXPECT_TRUE(scene.data.welcome.grid.contains(key));
      points.insert({key.x, key.y, key.z});
      EXPECT_TRUE(keys.insert(key.code()).second);
    }
  EXPECT_EQ(points.size(), 5U);
  EXPECT_EQ(keys.size(), 30U);
}

// A client that asks for 8 points blends 16 images. One or two points give at least 8 faces.
TEST(ViewPlan, noMoreFacesThanAClientBlends) {
  const server::TestScene scene;
  protocol::View view = scene.view(1, {0.3, 0.3, 0.6});
  view.camera.fov_y = 2.0;
  std::size_t before = 0;
  for (const std::uint16_t points : {1, 2, 4, 8}) {
    view.max_points = points;
    const ViewPlan plan = planView(scene.data.toPlan(), view);
    EXPECT_LE(plan.faces.size(), std::max<std::size_t>(8, std::size_t{2} * points));
    EXPECT_GE(plan.faces.size(), before);
    before = plan.faces.size();
  }
  EXPECT_EQ(before, 16U) << "of 8 points more faces see something";
}

TEST(ViewPlan, presentFacesAreLeftOutAndNotReplaced) {
  const server::TestScene scene;
  const protocol::View view = scene.view(1, {0.3, 0.3, 0.6});
  const ViewPlan whole = planView(scene.data.toPlan(), view);
  ASSERT_GT(whole.faces.size(), 3U);
  Holdings present;
  present.face = [&](const repository::FaceKey& key) { return key == whole.faces[0] || key == whole.faces[2]; };
  const ViewPlan rest = planView(scene.data.toPlan(), view, present);
  std::set<repository::FaceKey> wanted(whole.faces.begin(), whole.faces.end());
  std::erase_if(wanted, present.face);
  EXPECT_EQ(std::set<repository::FaceKey>(rest.faces.begin(), rest.faces.end()), wanted);
  EXPECT_EQ(rest.other_faces, whole.other_faces);
}

// Viewers inside the model, far away, beside the grid or on one of its points get an answer like all others.
TEST(ViewPlan, anyEyeIsServed) {
  const server::TestScene scene;
  for (const glm::dvec3& from :
       {glm::dvec3(0, 0, 0.001), glm::dvec3(0, 0, 1e6), glm::dvec3(-50, 20, 3), glm::dvec3(0, 0, -0.5),
        glm::dvec3(scene.data.welcome.grid.point(3, 3, 1) - glm::vec3(scene.center())) / 32.0}) {
    protocol::View view = scene.view(1, from, {0.01, 0.0, 0.0});
    const ViewPlan plan = planView(scene.data.toPlan(), view);
    EXPECT_GE(plan.groups.size(), 1U);
    for (const auto& key : plan.faces) EXPECT_TRUE(scene.data.welcome.grid.contains(key));
  }
}

}  // namespace
}  // namespace plan
