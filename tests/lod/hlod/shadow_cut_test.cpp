#include "lod/hlod/shadow_cut.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <set>

#include "tests/support/random_views.h"

namespace lod::hlod {
namespace {

using Numbers = std::vector<std::uint32_t>;

constexpr float kInfinite = std::numeric_limits<float>::infinity();

/// An octree around `center`, of which some cells are empty. A node's errors are its edge divided by 100, a leaf's 0.
struct Octree {
  Octree(const glm::vec3& center, float radius, std::uint32_t depth, unsigned seed)
      : bounds{center, radius * 1.8F}, random(seed, bounds, 100) {
    std::vector<base::Aabb> cells{{center - radius, center + radius}};
    addNode(cells[0], radius);
    std::size_t begin = 0;
    for (std::uint32_t level = 1; level <= depth; ++level) {
      const std::size_t end = nodes.size();
      for (std::size_t parent = begin; parent < end; ++parent) addChildren(parent, level == depth, cells);
      begin = end;
    }
  }
  void addNode(const base::Aabb& cell, float edge) {
    Node node;
    node.box = cell;
    node.error = node.shape_error = node.caster_error = 0.01F * edge;
    nodes.push_back(node);
    parents.push_back(0);
  }
  void addChildren(std::size_t parent, bool is_last, std::vector<base::Aabb>& cells) {
    nodes[parent].first_child = static_cast<std::uint32_t>(nodes.size());
    for (int i = 0; i < 8; ++i) {
      if (random.number(0.0, 1.0) < 0.35 && (i > 0 || nodes[parent].children > 0)) continue;
      const glm::vec3 corner = cells[parent].corner(i), center = cells[parent].center();
      const base::Aabb cell{glm::min(corner, center), glm::max(corner, center)};
      cells.push_back(cell);
      addNode(cell, is_last ? 0.0F : cell.longest());
      parents.back() = static_cast<std::uint32_t>(parent);
      ++nodes[parent].children;
    }
  }
  /// Whether one of these nodes is the node or above it.
  bool isCovered(std::uint32_t node, const Numbers& by) const {
    while (!std::binary_search(by.begin(), by.end(), node)) {
      if (node == 0) return false;
      node = parents[node];
    }
    return true;
  }

  std::vector<Node> nodes;
  Numbers parents;
  base::Sphere bounds;
  support::RandomViews random;
};

glm::dvec3 clipOf(const base::Camera& camera, const glm::dvec3& point) {
  const glm::dvec4 clip = glm::dmat4(camera.clip_from_eye) * (glm::dmat4(camera.eye_from_scene) * glm::dvec4(point, 1));
  return clip.w > 0.0 ? glm::dvec3(clip) / clip.w : glm::dvec3(9.0);
}
bool isSeen(const base::Camera& camera, const glm::dvec3& point) {
  const glm::dvec3 clip = glm::abs(clipOf(camera, point));
  return clip.x <= 1.0 && clip.y <= 1.0 && clip.z <= 1.0;
}
/// As it is computed on a GPU.
glm::vec3 roundedClipOf(const base::Camera& camera, const glm::vec3& point) {
  const glm::vec4 clip = camera.clipFromScene() * glm::vec4(point, 1.0F);
  return glm::vec3(clip) / clip.w;
}
/// The way that a short step goes in the picture for a unit of its length: pixels.
double speedOf(const base::Camera& camera, const glm::dvec3& point, const glm::dvec3& direction, double step) {
  const glm::dvec2 moved(clipOf(camera, point + step * direction) - clipOf(camera, point - step * direction));
  return glm::length(moved * glm::dvec2(camera.width, camera.height)) / (4.0 * step);
}

glm::dvec3 pointIn(support::RandomViews& random, const base::Aabb& box) {
  const glm::dvec3 part(random.number(0.0, 1.0), random.number(0.0, 1.0), random.number(0.0, 1.0));
  return glm::dvec3(box.min) + part * glm::dvec3(box.size());
}

/// The part of the way from `from` in `direction`, in its units, that lies in the box.
std::optional<std::pair<double, double>> partInBox(const base::Aabb& box, const glm::dvec3& from,
                                                   const glm::dvec3& direction) {
  double begin = 0.0, end = std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis) {
    const double low = static_cast<double>(box.min[axis]), high = static_cast<double>(box.max[axis]);
    if (direction[axis] == 0.0) {
      if (from[axis] < low || from[axis] > high) return std::nullopt;
      continue;
    }
    const double a = (low - from[axis]) / direction[axis], b = (high - from[axis]) / direction[axis];
    begin = std::max(begin, std::min(a, b)), end = std::min(end, std::max(a, b));
  }
  if (begin > end) return std::nullopt;
  return std::pair(begin, end);
}

// ---- the formula ----

// Figure 4, left: where a ray from the light past a caster's edge meets a receiver that faces the light.
TEST(HlodShadowTest, aCasterThatIsOffByItsErrorMovesAHardShadowByTheReceiversError) {
  support::RandomViews random(1, {glm::vec3(0.0F), 1.0F}, 100);
  double largest = 0.0;
  for (int i = 0; i < 20'000; ++i) {
    ShadowLight light;
    const glm::dvec3 place = 10.0 * random.direction(), ray = random.direction();
    light.place = glm::vec4(glm::vec3(place), 1.0F);
    const double d_l = random.number(0.5, 10.0), d_p = random.number(0.0, 20.0), receiver = 1e-4;
    const double error = static_cast<double>(
        casterError(light, static_cast<float>(receiver), 0.5F, static_cast<float>(d_l), static_cast<float>(d_p)));
    const glm::dvec3 edge = place + d_l * ray + error * random.direction();
    const glm::dvec3 shadow = place + (edge - place) * ((d_l + d_p) / glm::dot(edge - place, ray));
    const double moved = glm::length(shadow - (place + (d_l + d_p) * ray));
    ASSERT_LE(moved, 1.001 * receiver);
    largest = std::max(largest, moved / receiver);
  }
  EXPECT_GT(largest, 0.999);
}

// Figure 4, right: how much of a light is seen past the caster's straight edge.
TEST(HlodShadowTest, aCasterThatIsOffByItsErrorChangesASoftShadowByTheIntensityThatIsAllowed) {
  support::RandomViews random(2, {glm::vec3(0.0F), 1.0F}, 100);
  for (int i = 0; i < 1000; ++i) {
    ShadowLight light;
    light.place = glm::vec4(0.0F, 0.0F, 0.0F, 1.0F);
    light.size = static_cast<float>(random.number(0.1, 2.0));
    const double d_l = random.number(0.5, 10.0), d_p = random.number(0.1, 20.0), change = random.number(0.01, 0.3);
    const double error = static_cast<double>(
        casterError(light, 0.0F, static_cast<float>(change), static_cast<float>(d_l), static_cast<float>(d_p)));
    // The light is a line from −s / 2 to s / 2. A ray from a receiver past the edge meets it at:
    const double receiver = random.number(-0.1, 0.1);
    const auto met = [&](double edge) { return receiver + (edge - receiver) * (d_l + d_p) / d_p; };
    EXPECT_NEAR(std::abs(met(error) - met(0.0)) / static_cast<double>(light.size), change, 1e-4 * change);
  }
}

TEST(HlodShadowTest, errorsOfCastersHaveTheirLimits) {
  ShadowLight far{glm::vec4(0.0F, 0.0F, 1.0F, 0.0F), 0.01F};
  ShadowLight near{glm::vec4(0.0F, 0.0F, 1e7F, 1.0F), 1e5F};
  EXPECT_NEAR(casterError(far, 0.5F, 0.1F, 0.0F, 100.0F), 0.6F, 1e-5F);
  EXPECT_NEAR(casterError(near, 0.5F, 0.1F, 1e7F, 100.0F), 0.6F, 1e-4F);
  far.size = near.size = 0.0F;
  EXPECT_EQ(casterError(far, 0.5F, 0.1F, 0.0F, 100.0F), 0.5F);
  EXPECT_EQ(casterError(near, 0.5F, 0.1F, 3.0F, 3.0F), 0.25F);
  EXPECT_EQ(casterError(near, 0.5F, 0.1F, 0.0F, 3.0F), 0.0F);
  EXPECT_EQ(casterError(near, 0.5F, 0.1F, 3.0F, 0.0F), 0.5F);
  EXPECT_EQ(casterError(near, 0.5F, 0.1F, 0.0F, 0.0F), 0.5F);
}

// ---- plans ----

/// A view, a light and what is planned for them.
struct Case {
  ShadowRequest request;
  Numbers receivers;
  std::vector<ShadowMapPlan> plans;
};

enum class Place { kFar, kGrazing, kOutside, kInside, kBehindViewer };

ShadowLight lightAt(Octree& tree, const base::Camera& camera, Place place) {
  support::RandomViews& random = tree.random;
  const glm::dvec3 center(tree.bounds.center);
  const auto radius = static_cast<double>(tree.bounds.radius);
  const glm::dvec3 back(camera.eye_from_scene[0][2], camera.eye_from_scene[1][2], camera.eye_from_scene[2][2]);
  glm::dvec3 at(0.0);
  switch (place) {
    case Place::kFar:
      return {glm::vec4(glm::vec3(random.direction()), 0.0F)};
    case Place::kGrazing:  // nearly along the view, from both sides
      return {glm::vec4(
          glm::vec3(glm::normalize((random.number(-1.0, 1.0) < 0.0 ? -back : back) + 1e-3 * random.direction())),
          0.0F)};
    case Place::kOutside:
      at = center + random.direction() * radius * random.number(1.1, 6.0);
      break;
    case Place::kInside:
      at = center + random.direction() * radius * random.number(0.0, 0.6);
      break;
    case Place::kBehindViewer:
      at = glm::dvec3(camera.eye) + back * radius * random.number(0.001, 2.0);
      break;
  }
  return {glm::vec4(glm::vec3(at), 1.0F)};
}

Case planCase(Octree& tree, const base::Camera& camera, Place place, bool is_soft) {
  Case made;
  made.request.view.camera = camera;
  made.request.view.tolerance = static_cast<float>(tree.random.number(0.4, 3.0));
  made.request.light = lightAt(tree, camera, place);
  if (is_soft)
    made.request.light.size = static_cast<float>(tree.random.number(0.01, 0.3)) *
                              (made.request.light.place.w == 0.0F ? 1.0F : tree.bounds.radius);
  made.request.max_maps = static_cast<std::size_t>(tree.random.number(1.0, 6.0));
  made.request.max_texels = 1U << 30;
  made.receivers = chooseCut(tree.nodes, made.request.view);
  made.plans = planShadowMaps(tree.nodes, made.receivers, made.request);
  return made;
}

/// A camera whose eye may lie in the model, too.
base::Camera anyCamera(Octree& tree, int number) {
  if (number % 4 != 0) return tree.random.next();
  base::ViewCamera view;
  const auto radius = static_cast<double>(tree.bounds.radius);
  view.position = glm::dvec3(tree.bounds.center) + tree.random.direction() * radius * tree.random.number(0.0, 0.5);
  view.direction = tree.random.direction();
  view.up = tree.random.direction();
  view.width = view.height = 100;
  return base::cameraFromView(view, glm::dvec3(0.0), 0.01F * tree.bounds.radius, 3.0F * tree.bounds.radius);
}

struct Ray {
  glm::dvec3 direction;  ///< to the light; of its length where it is at a place
  double end = 0.0;      ///< the light, in these lengths
  bool is_central = true;
};

/// A ray from a receiver to a place of the light's disc, which faces the receiver.
Ray rayToLight(support::RandomViews& random, const ShadowLight& light, const glm::dvec3& from) {
  const glm::dvec3 place(light.place);
  const bool is_far = light.place.w == 0.0F;
  const glm::dvec3 towards = is_far ? place : place - from;
  const glm::dvec3 aside = glm::normalize(glm::cross(towards, random.direction()));
  const double half = 0.5 * static_cast<double>(light.size) * std::max(random.number(-1.0, 1.0), 0.0);
  if (is_far) return {towards + std::tan(half) * aside, std::numeric_limits<double>::infinity(), half == 0.0};
  return {towards + half * aside, 1.0, half == 0.0};
}

/// Counts what was compared, so that no check passes for want of cases.
struct Checked {
  int points = 0, crossings = 0, coarse = 0, maps = 0, shared = 0;
  double closest_texel = 0.0, closest_error = 0.0;
};

/// All that comes between a seen place and the light is in the map, and off by no more than its shadow's edge may be.
void checkRay(Octree& tree, const Case& made, const ShadowMapPlan& plan, const glm::dvec3& point, Checked& checked) {
  const ShadowRequest& request = made.request;
  const Ray ray = rayToLight(tree.random, request.light, point);
  const double length = glm::length(ray.direction);
  for (std::uint32_t n = 0; n < tree.nodes.size(); ++n) {
    const Node& node = tree.nodes[n];
    const bool is_caster = std::binary_search(plan.casters.begin(), plan.casters.end(), n);
    if (!node.isLeaf() && !is_caster) continue;
    const auto part = partInBox(node.box, point, ray.direction);
    if (!part || part->first >= ray.end) continue;
    ++checked.crossings;
    ASSERT_TRUE(!node.isLeaf() || tree.isCovered(n, plan.casters)) << "leaf " << n;
    // Distances of the formula are those from the light's middle.
    if (!is_caster || node.isLeaf() || !ray.is_central) continue;
    ++checked.coarse;
    for (const double share : {0.0, 0.5, 1.0}) {
      const double at = part->first + share * (std::min(part->second, ray.end) - part->first);
      const auto d_p = static_cast<float>(at * length), d_l = static_cast<float>((ray.end - at) * length);
      ASSERT_LE(node.caster_error,
                1.001F * casterError(request.light, plan.receiver_error, request.intensity_change, d_l, d_p));
    }
  }
}

/// A hard light's map shows all along the ray, but for what is very near to the light.
void checkDepths(const Octree& tree, const Case& made, const ShadowMapPlan& plan, const glm::dvec3& point) {
  const ShadowLight& light = made.request.light;
  const bool is_far = light.place.w == 0.0F;
  const glm::dvec3 direction = glm::dvec3(light.place) - (is_far ? glm::dvec3(0.0) : point);
  const double last =
      is_far ? kInfinite : 1.0 - 1e-3 * static_cast<double>(tree.bounds.radius) / glm::length(direction);
  for (const std::uint32_t caster : plan.casters) {
    const auto part = partInBox(tree.nodes[caster].box, point, direction);
    if (!part || part->first >= last) continue;
    const glm::dvec3 clip = clipOf(plan.camera, point + std::min(part->second, last) * direction);
    ASSERT_GE(clip.z, -1.0001);
    ASSERT_LE(clip.z, 1.0001);
  }
}

/// The texel and the error that the view tolerates there, in pixels.
void checkSizes(Octree& tree, const Case& made, const ShadowMapPlan& plan, const glm::dvec3& point, Checked& checked) {
  const ShadowLight& light = made.request.light;
  const double step = 1e-5 * static_cast<double>(tree.bounds.radius);
  const bool is_far = light.place.w == 0.0F;
  const glm::dvec3 ray = glm::dvec3(light.place) - (is_far ? glm::dvec3(0.0) : point);
  const double distance = glm::length(point - glm::dvec3(made.request.view.camera.eye));
  if ((!is_far && glm::length(ray) < 100.0 * step) || distance < 100.0 * step) return;
  double pixels = 0.0, texel = 0.0;
  for (int i = 0; i < 8; ++i) {
    pixels = std::max(pixels, speedOf(made.request.view.camera, point, tree.random.direction(), step));
    const glm::dvec3 aside = glm::normalize(glm::cross(ray, tree.random.direction()));
    texel = std::max(texel, 1.0 / speedOf(plan.camera, point, aside, step));
  }
  ASSERT_LE(texel * pixels, 1.01 * static_cast<double>(plan.texel_px));
  ASSERT_LE(pixels * static_cast<double>(plan.receiver_error), 1.01 * static_cast<double>(made.request.view.tolerance));
  checked.closest_texel = std::max(checked.closest_texel, texel * pixels / static_cast<double>(plan.texel_px));
  checked.closest_error =
      std::max(checked.closest_error, pixels * static_cast<double>(plan.receiver_error / made.request.view.tolerance));
}

/// The maps that show a seen place of a receiver, each of which knows all that shadows it there.
void checkPoint(Octree& tree, const Case& made, std::uint32_t receiver, const glm::dvec3& point, Checked& checked) {
  ++checked.points;
  int maps = 0;
  for (const ShadowMapPlan& plan : made.plans) {
    if (!std::binary_search(plan.receivers.begin(), plan.receivers.end(), receiver)) continue;
    if (!isSeen(plan.camera, point)) continue;
    ++maps;
    ASSERT_NO_FATAL_FAILURE(checkRay(tree, made, plan, point, checked));
    if (made.request.light.size == 0.0F) {
      ASSERT_NO_FATAL_FAILURE(checkDepths(tree, made, plan, point));
    }
    ASSERT_NO_FATAL_FAILURE(checkSizes(tree, made, plan, point, checked));
  }
  ASSERT_GT(maps, 0) << "no map shows the place";
}

void checkCase(Octree& tree, const Case& made, Checked& checked) {
  for (const ShadowMapPlan& plan : made.plans) {
    ++checked.maps;
    ASSERT_TRUE(std::is_sorted(plan.receivers.begin(), plan.receivers.end()));
    ASSERT_TRUE(std::is_sorted(plan.casters.begin(), plan.casters.end()));
    for (const std::uint32_t caster : plan.casters)
      ASSERT_TRUE(caster == 0 || !tree.isCovered(tree.parents[caster], plan.casters)) << "casters are no cut";
    ASSERT_LE(plan.texel_px, 1.0001F * made.request.texel_px);
    ASSERT_GT(plan.receiver_error, 0.0F);
  }
  for (int i = 0; i < 200 && !made.receivers.empty(); ++i) {
    const auto receiver =
        static_cast<std::uint32_t>(tree.random.number(0.0, static_cast<double>(made.receivers.size()) - 1e-6));
    const glm::dvec3 point = pointIn(tree.random, tree.nodes[made.receivers[receiver]].box);
    if (!isSeen(made.request.view.camera, point)) continue;
    ASSERT_NO_FATAL_FAILURE(checkPoint(tree, made, receiver, point, checked));
  }
}

void checkManyCases(Octree& tree, int cases) {
  for (const Place place : {Place::kFar, Place::kGrazing, Place::kOutside, Place::kInside, Place::kBehindViewer}) {
    Checked checked;
    for (int i = 0; i < cases; ++i) {
      const Case made = planCase(tree, anyCamera(tree, i), place, i % 3 == 0);
      ASSERT_NO_FATAL_FAILURE(checkCase(tree, made, checked)) << "light " << static_cast<int>(place) << ", case " << i;
    }
    EXPECT_GT(checked.points, 10 * cases);
    EXPECT_GT(checked.crossings, 100 * cases);
    EXPECT_GT(checked.coarse, cases);
    EXPECT_GT(checked.maps, cases);
    EXPECT_GT(checked.closest_texel, 0.7) << "texels are far smaller than stated";
    EXPECT_GT(checked.closest_error, 0.7) << "the receivers' error is far smaller than tolerated";
  }
}

TEST(HlodShadowTest, allThatMayShadowASeenPlaceIsInItsMap) {
  Octree tree(glm::vec3(0.3F, -0.2F, 0.1F), 1.0F, 4, 7);
  ASSERT_GT(tree.nodes.size(), 500U);
  checkManyCases(tree, 60);
}

TEST(HlodShadowTest, plansAreRightFarFromTheZero) {
  Octree tree(glm::vec3(1e6F, -2e6F, 5e5F), 3000.0F, 4, 8);
  checkManyCases(tree, 30);
}

TEST(HlodShadowTest, mapOfTheSceneServesAllViewsOfAsManyPixels) {
  Octree tree(glm::vec3(0.3F, -0.2F, 0.1F), 1.0F, 4, 9);
  Checked checked;
  for (int i = 0; i < 60; ++i) {
    Case made = planCase(tree, tree.random.next(), i % 2 == 0 ? Place::kFar : Place::kOutside, i % 3 == 0);
    double most = 0.0;
    for (const std::uint32_t receiver : made.receivers)
      most = std::max(most, largestScale(made.request.view, tree.nodes[receiver].box));
    ASSERT_GT(most, 0.0);
    auto plan = planSceneShadowMap(tree.nodes, most, made.request);
    if (!plan) {
      EXPECT_EQ(made.request.light.place.w, 1.0F);  // beside the scene's box
      continue;
    }
    EXPECT_TRUE(plan->receivers.empty());
    for (std::uint32_t receiver = 0; receiver < made.receivers.size(); ++receiver) plan->receivers.push_back(receiver);
    made.plans = {*plan};
    ASSERT_NO_FATAL_FAILURE(checkCase(tree, made, checked)) << "case " << i;

    // The view is of no consequence.
    ShadowRequest elsewhere = made.request;
    elsewhere.view.camera = tree.random.next();
    const auto same = planSceneShadowMap(tree.nodes, most, elsewhere);
    ASSERT_TRUE(same);
    EXPECT_TRUE(base::sameCamera(same->camera, plan->camera));
    EXPECT_EQ(same->casters, plan->casters);
    // A finer one would be larger than this.
    elsewhere.max_texels = static_cast<std::uint32_t>(std::max(plan->camera.width, plan->camera.height));
    EXPECT_TRUE(planSceneShadowMap(tree.nodes, most, elsewhere));
    EXPECT_FALSE(planSceneShadowMap(tree.nodes, 1.1 * most, elsewhere));
  }
  EXPECT_GT(checked.points, 1000);
  EXPECT_GT(checked.crossings, 1000);
  const ShadowRequest amid{.view = {}, .light = {glm::vec4(tree.bounds.center, 1.0F)}};
  EXPECT_FALSE(planSceneShadowMap(tree.nodes, 100.0, amid)) << "it takes six maps";
}

// The GPU's float32 places stay within the map.
TEST(HlodShadowTest, windowsHaveRoomForRounding) {
  for (const float far_away : {0.0F, 1e6F}) {
    Octree tree(glm::vec3(far_away), 3000.0F, 3, 9);
    int compared = 0;
    for (int i = 0; i < 60; ++i) {
      Case made = planCase(tree, tree.random.next(), i % 2 == 0 ? Place::kFar : Place::kOutside, false);
      for (const ShadowMapPlan& plan : made.plans) {
        for (const std::uint32_t receiver : plan.receivers) {
          for (int corner = 0; corner < 8; ++corner) {
            const glm::vec3 point = tree.nodes[made.receivers[receiver]].box.corner(corner);
            if (!isSeen(made.request.view.camera, glm::dvec3(point)) || made.plans.size() > made.request.max_maps)
              continue;
            ++compared;
            const glm::vec3 clip = glm::abs(roundedClipOf(plan.camera, point));
            ASSERT_LE(std::max({clip.x, clip.y, clip.z}), 1.0F);
          }
        }
      }
    }
    EXPECT_GT(compared, 1000);
  }
}

/// Those of all plans, sorted.
Numbers receiversOf(const std::vector<ShadowMapPlan>& plans) {
  Numbers all;
  for (const ShadowMapPlan& plan : plans) all.insert(all.end(), plan.receivers.begin(), plan.receivers.end());
  std::sort(all.begin(), all.end());
  return all;
}

TEST(HlodShadowTest, levelsShareMapsUntilThereAreFew) {
  Octree tree(glm::vec3(0.0F), 1.0F, 5, 10);
  std::size_t most = 0;
  for (int i = 0; i < 40; ++i) {
    Case made = planCase(tree, tree.random.next(), Place::kFar, false);
    double texels = 0.0;
    std::size_t levels = 0;
    for (const std::size_t max_maps : {std::size_t{22}, std::size_t{3}, std::size_t{2}, std::size_t{1}}) {
      made.request.max_maps = max_maps;
      made.plans = planShadowMaps(tree.nodes, made.receivers, made.request);
      if (max_maps == 22) levels = made.plans.size();
      EXPECT_EQ(made.plans.size(), std::min(max_maps, levels));
      // Each receiver that is seen is in one map.
      const Numbers all = receiversOf(made.plans);
      EXPECT_TRUE(std::adjacent_find(all.begin(), all.end()) == all.end());
      double sum = 0.0;
      for (const ShadowMapPlan& plan : made.plans)
        sum += static_cast<double>(plan.camera.width) * static_cast<double>(plan.camera.height);
      EXPECT_GE(sum, 0.9 * texels - 1000.0) << "fewer maps have fewer texels";
      texels = sum;
    }
    most = std::max(most, levels);
  }
  EXPECT_GE(most, 3U);
}

// By a far light without size a caster is just as fine as the receivers tolerate, wherever it is.
TEST(HlodShadowTest, castersAreNotFinerThanNeeded) {
  Octree tree(glm::vec3(0.0F), 1.0F, 5, 11);
  std::size_t inner = 0, finer = 0;
  for (int i = 0; i < 40; ++i) {
    const Case made = planCase(tree, tree.random.next(), Place::kFar, false);
    for (const ShadowMapPlan& plan : made.plans)
      for (const std::uint32_t caster : plan.casters) {
        inner += tree.nodes[caster].isLeaf() ? 0 : 1;
        if (caster == 0) continue;
        ++finer;
        ASSERT_GT(tree.nodes[tree.parents[caster]].caster_error, plan.receiver_error);
      }
  }
  EXPECT_GT(inner, 100U);
  EXPECT_GT(finer, 100U);
}

TEST(HlodShadowTest, farAwayFromReceiversALargeLightTakesCoarserCasters) {
  Octree tree(glm::vec3(0.0F), 1.0F, 5, 12);
  std::size_t hard = 0, soft = 0;
  for (int i = 0; i < 40; ++i) {
    Case made = planCase(tree, tree.random.next(), Place::kFar, false);
    made.request.light.size = 0.3F;
    for (const float change : {0.0F, 0.2F}) {
      made.request.intensity_change = change;
      for (const ShadowMapPlan& plan : planShadowMaps(tree.nodes, made.receivers, made.request))
        for (const std::uint32_t caster : plan.casters)
          (change > 0.0F ? soft : hard) += tree.nodes[caster].isLeaf() ? 1 : 0;
    }
  }
  EXPECT_LT(10 * soft, 9 * hard);
  EXPECT_GT(soft, 0U);
}

TEST(HlodShadowTest, mapsThatWouldBeTooLargeHaveLargerTexels) {
  Octree tree(glm::vec3(0.0F), 1.0F, 4, 13);
  int limited = 0;
  for (int i = 0; i < 40; ++i) {
    Case made = planCase(tree, tree.random.next(), i % 2 == 0 ? Place::kFar : Place::kOutside, false);
    made.request.max_texels = 64;
    made.request.max_maps = 1;
    made.plans = planShadowMaps(tree.nodes, made.receivers, made.request);
    Checked checked;
    for (const ShadowMapPlan& plan : made.plans) {
      EXPECT_LE(std::max(plan.camera.width, plan.camera.height), 64);
      EXPECT_GE(std::min(plan.camera.width, plan.camera.height), 1);
      if (plan.texel_px <= 1.0001F * made.request.texel_px) continue;
      ++limited;
      EXPECT_EQ(std::max(plan.camera.width, plan.camera.height), 64);
      for (const std::uint32_t receiver : plan.receivers) {
        const glm::dvec3 point = pointIn(tree.random, tree.nodes[made.receivers[receiver]].box);
        if (!isSeen(made.request.view.camera, point) || !isSeen(plan.camera, point)) continue;
        ASSERT_NO_FATAL_FAILURE(checkSizes(tree, made, plan, point, checked));
      }
    }
  }
  EXPECT_GT(limited, 10);
}

/// The first map that holds a place of the receiver, as it is drawn; null where there is none.
const ShadowMapPlan* mapFor(const Case& made, std::uint32_t receiver, const glm::dvec3& point) {
  for (const ShadowMapPlan& plan : made.plans) {
    if (!std::binary_search(plan.receivers.begin(), plan.receivers.end(), receiver)) continue;
    if (!isSeen(plan.camera, point)) continue;
    const bool is_in_slice = std::all_of(plan.slice.begin(), plan.slice.end(), [&](const glm::dvec4& plane) {
      return glm::dot(plane, glm::dvec4(point, 1.0)) >= 0.0;
    });
    if (is_in_slice) return &plan;
  }
  return nullptr;
}

/// Places that are seen are in a map that knows all that shadows them.
void checkMapsOfPlaces(Octree& tree, const Case& made, Checked& checked) {
  for (int i = 0; i < 100 && !made.receivers.empty(); ++i) {
    const auto receiver =
        static_cast<std::uint32_t>(tree.random.number(0.0, static_cast<double>(made.receivers.size()) - 1e-6));
    const glm::dvec3 point = pointIn(tree.random, tree.nodes[made.receivers[receiver]].box);
    if (!isSeen(made.request.view.camera, point)) continue;
    ++checked.points;
    const ShadowMapPlan* plan = mapFor(made, receiver, point);
    ASSERT_NE(plan, nullptr) << "no map shows the place";
    ASSERT_NO_FATAL_FAILURE(checkRay(tree, made, *plan, point, checked));
    ASSERT_NO_FATAL_FAILURE(checkSizes(tree, made, *plan, point, checked));
  }
}

float coarsestTexel(const std::vector<ShadowMapPlan>& plans) {
  float coarsest = 0.0F;
  for (const ShadowMapPlan& plan : plans) coarsest = std::max(coarsest, plan.texel_px);
  return coarsest;
}

TEST(HlodShadowTest, slicesOfAViewAreAsFineAsTheyMustBe) {
  Octree tree(glm::vec3(0.0F), 1.0F, 4, 15);
  Checked checked;
  int finer = 0;
  for (int i = 0; i < 40; ++i) {
    Case made = planCase(tree, anyCamera(tree, 0), i % 2 == 0 ? Place::kFar : Place::kOutside, false);
    made.request.max_texels = 150;
    made.request.max_maps = 1;
    const float coarse = coarsestTexel(planShadowMaps(tree.nodes, made.receivers, made.request));
    made.request.max_maps = 8;
    made.plans = planShadowMaps(tree.nodes, made.receivers, made.request);
    EXPECT_LE(coarsestTexel(made.plans), 1.01F * coarse);
    finer += 2.0F * coarsestTexel(made.plans) < coarse ? 1 : 0;
    ASSERT_NO_FATAL_FAILURE(checkMapsOfPlaces(tree, made, checked)) << "case " << i;
  }
  EXPECT_GT(finer, 10);
  EXPECT_GT(checked.points, 400);
}

/// The camera after a small step and a small turn.
base::Camera moved(const base::Camera& camera, Octree& tree, double step) {
  const glm::dvec3 axis = tree.random.direction();
  const glm::dvec3 shift = step * static_cast<double>(tree.bounds.radius) * tree.random.direction();
  const glm::dmat4 turn = glm::rotate(glm::dmat4(1.0), step, axis);
  base::Camera next = camera;
  next.eye_from_scene = glm::mat4(glm::translate(turn, shift) * glm::dmat4(camera.eye_from_scene));
  next.eye = glm::vec3(glm::inverse(glm::dmat4(next.eye_from_scene))[3]);
  return next;
}

// Most views of a moving eye are served by the maps of one before, and no worse than by maps of their own.
TEST(HlodShadowTest, mapsServeTheNextViews) {
  Octree tree(glm::vec3(0.0F), 1.0F, 4, 16);
  for (const std::uint32_t max_texels : {1U << 30, 300U}) {
    Checked checked;
    int views = 0, kept = 0;
    for (int i = 0; i < 24; ++i) {
      // A light amid receivers has maps that do not see all of the room around it.
      const Place place = std::array{Place::kFar, Place::kOutside, Place::kInside}[static_cast<std::size_t>(i) % 3];
      Case made = planCase(tree, anyCamera(tree, i), place, i % 2 == 0);
      made.request.room = 0.15F;
      made.request.max_texels = max_texels;
      ShadowPlanner planner;
      std::vector<base::Camera> before;
      for (int step = 0; step < 12; ++step) {
        views += place != Place::kInside ? 1 : 0;
        made.request.view.camera = moved(made.request.view.camera, tree, 0.002);
        made.receivers = chooseCut(tree.nodes, made.request.view);
        made.plans = planner.plan(tree.nodes, receiversOf(tree.nodes, made.receivers), made.request);
        ASSERT_NO_FATAL_FAILURE(checkMapsOfPlaces(tree, made, checked)) << "case " << i << ", step " << step;
        std::vector<base::Camera> maps;
        for (const ShadowMapPlan& plan : made.plans) maps.push_back(plan.camera);
        kept += step > 0 && place != Place::kInside &&
                std::equal(maps.begin(), maps.end(), before.begin(), before.end(), base::sameCamera);
        before = std::move(maps);
      }
    }
    EXPECT_GT(2 * kept, views);
    EXPECT_GT(checked.points, 4000);
  }
}

TEST(HlodShadowTest, aLightThatMovesHasMapsOfItsOwn) {
  Octree tree(glm::vec3(0.0F), 1.0F, 4, 17);
  Case made = planCase(tree, tree.random.next(), Place::kFar, false);
  made.request.room = 0.15F;
  ShadowPlanner planner;
  const auto receivers = receiversOf(tree.nodes, made.receivers);
  const base::Camera first = planner.plan(tree.nodes, receivers, made.request).front().camera;
  EXPECT_TRUE(base::sameCamera(planner.plan(tree.nodes, receivers, made.request).front().camera, first));
  made.request.light.place = glm::vec4(glm::normalize(glm::vec3(made.request.light.place) + 0.01F), 0.0F);
  EXPECT_FALSE(base::sameCamera(planner.plan(tree.nodes, receivers, made.request).front().camera, first));
}

TEST(HlodShadowTest, aLightAmongReceiversHasAMapForEachSide) {
  Octree tree(glm::vec3(0.0F), 1.0F, 4, 14);
  std::set<std::size_t> counts;
  for (int i = 0; i < 60; ++i) {
    Case made = planCase(tree, tree.random.next(), Place::kInside, false);
    made.request.max_maps = 1;
    made.plans = planShadowMaps(tree.nodes, made.receivers, made.request);
    counts.insert(made.plans.size());
    for (const ShadowMapPlan& plan : made.plans) EXPECT_FALSE(plan.camera.orthographic());
  }
  EXPECT_EQ(*counts.rbegin(), 6U);
}

TEST(HlodShadowTest, onlyWhatTheViewShowsReceivesAndOnlyWhatTheSectionLeavesCasts) {
  Octree tree(glm::vec3(0.0F), 1.0F, 4, 15);
  std::size_t cut = 0, whole = 0;
  int fewer = 0;
  for (int i = 0; i < 40; ++i) {
    Case made = planCase(tree, tree.random.next(), Place::kFar, false);
    for (const ShadowMapPlan& plan : made.plans) whole += plan.casters.size();
    made.request.view.camera.section = glm::vec4(glm::vec3(tree.random.direction()), 0.1F);
    for (const ShadowMapPlan& plan : planShadowMaps(tree.nodes, made.receivers, made.request)) {
      cut += plan.casters.size();
      for (const std::uint32_t caster : plan.casters) {
        float least = kInfinite;
        for (int corner = 0; corner < 8; ++corner)
          least = std::min(
              least, glm::dot(glm::vec3(made.request.view.camera.section), tree.nodes[caster].box.corner(corner)));
        EXPECT_LE(least, made.request.view.camera.section.w + 1e-5F);
      }
    }
    // A tile's maps hold receivers of the picture's, but not all.
    made.request.view.camera.section = base::kNoSection;
    made.request.view.tile = made.request.view.camera;
    for (int column = 0; column < 4; ++column)
      for (int row = 0; row < 2; ++row) made.request.view.tile->clip_from_eye[column][row] *= 4.0F;
    const Numbers all = receiversOf(made.plans);
    const Numbers part = receiversOf(planShadowMaps(tree.nodes, made.receivers, made.request));
    EXPECT_TRUE(std::includes(all.begin(), all.end(), part.begin(), part.end()));
    fewer += part.size() < all.size() ? 1 : 0;
  }
  EXPECT_GT(fewer, 5);
  EXPECT_LT(cut, whole);
}

TEST(HlodShadowTest, oddLightsAndCamerasAreBorne) {
  Octree tree(glm::vec3(0.0F), 1.0F, 3, 16);
  Case made = planCase(tree, tree.random.next(), Place::kFar, false);
  ASSERT_FALSE(made.plans.empty());
  EXPECT_TRUE(planShadowMaps({}, std::span<const std::uint32_t>(), made.request).empty());
  EXPECT_TRUE(planShadowMaps(tree.nodes, std::span<const std::uint32_t>(), made.request).empty());
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const glm::vec4& place :
       {glm::vec4(nan, 0.0F, 0.0F, 1.0F), glm::vec4(0.0F), glm::vec4(kInfinite, 0.0F, 0.0F, 1.0F)}) {
    ShadowRequest request = made.request;
    request.light.place = place;
    EXPECT_TRUE(planShadowMaps(tree.nodes, made.receivers, request).empty());
  }
  ShadowRequest request = made.request;
  request.view.camera.clip_from_eye[1][1] = nan;
  EXPECT_TRUE(planShadowMaps(tree.nodes, made.receivers, request).empty());
  // Lights at the eye, at a corner of a box, and in a plane of it.
  Checked checked;
  for (int i = 0; i < 40; ++i) {
    Case odd = planCase(tree, tree.random.next(), Place::kInside, false);
    const base::Aabb& box = tree.nodes[static_cast<std::size_t>(i) % tree.nodes.size()].box;
    const glm::vec3 places[]{odd.request.view.camera.eye, box.corner(i % 8), 0.5F * (box.corner(1) + box.corner(4))};
    odd.request.light.place = glm::vec4(places[i % 3], 1.0F);
    odd.plans = planShadowMaps(tree.nodes, odd.receivers, odd.request);
    ASSERT_NO_FATAL_FAILURE(checkCase(tree, odd, checked));
  }
  EXPECT_GT(checked.points, 400);
}

}  // namespace
}  // namespace lod::hlod
