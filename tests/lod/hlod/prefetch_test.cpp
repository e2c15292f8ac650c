#include "lod/hlod/prefetch.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/gtc/matrix_transform.hpp>
#include <map>
#include <set>

#include "tests/lod/hlod/made_stream.h"
#include "tests/support/random_views.h"

namespace lod::hlod {
namespace {

constexpr std::uint64_t kAll = 1ULL << 60;

/// The same view, turned about its eye by an angle, radians.
TraverseRequest turned(TraverseRequest request, const glm::vec3& axis, float angle) {
  request.camera.eye_from_scene = glm::rotate(glm::mat4(1.0F), angle, axis) * request.camera.eye_from_scene;
  return request;
}

std::map<std::uint32_t, float> motionsOf(const TraverseRequest& request) {
  std::map<std::uint32_t, float> motions;
  for (const NextNode& next : nodesWantedNext(made().nodes, request, kAll)) {
    EXPECT_FALSE(motions.contains(next.node)) << "a node comes twice";
    motions[next.node] = next.motion;
  }
  return motions;
}

TEST(HlodPrefetchTest, whatAViewWantsAfterItHasTurnedNeedsNoLargerMotion) {
  support::RandomViews views(4, made().header.bounds, 400);
  int wanted = 0, parallel = 0;
  for (int i = 0; i < 400; ++i) {
    TraverseRequest request;
    request.camera = views.next();
    request.tolerance = static_cast<float>(views.number(0.5, 4.0));
    const bool is_parallel = request.camera.orthographic();
    const Numbers now = cutOf(request);
    const std::set<std::uint32_t> here(now.begin(), now.end());
    const std::map<std::uint32_t, float> motions = motionsOf(request);
    for (const auto& [node, motion] : motions) ASSERT_FALSE(here.contains(node));
    const auto amount = static_cast<float>(views.number(0.05, is_parallel ? 0.5 : 3.0));
    TraverseRequest moved = turned(request, glm::vec3(views.direction()), amount);
    if (is_parallel) {  // a step aside, in parts of the picture's height
      moved = request;
      const float height = 2.0F / request.camera.clip_from_eye[1][1], turn = static_cast<float>(views.number(0.0, 6.0));
      moved.camera.eye_from_scene[3] += height * amount * glm::vec4(std::cos(turn), std::sin(turn), 0.0F, 0.0F);
    }
    for (const std::uint32_t node : cutOf(moved)) {
      if (here.contains(node)) continue;
      // A turn changes how obliquely a node is seen, and so its error; what then is coarser or finer is another matter.
      if (!motions.contains(node)) continue;
      ++wanted;
      parallel += is_parallel ? 1 : 0;
      const Node& parent = made().nodes[parentOf(node)];
      const bool is_child = here.contains(parentOf(node)) && parent.error > 0.0F;
      ASSERT_TRUE(is_child || motions.at(node) <= 1.001F * amount + 1e-4F);
    }
  }
  EXPECT_GT(wanted, 1000);
  EXPECT_GT(parallel, 20);
}

TEST(HlodPrefetchTest, turningByLessThanTheMotionShowsNothingOfANode) {
  support::RandomViews views(6, made().header.bounds, 400);
  float closest = 1e9F;
  int compared = 0;
  for (int i = 0; i < 100; ++i) {
    TraverseRequest request;
    request.camera = views.next();
    if (request.camera.orthographic()) continue;
    for (const NextNode& next : nodesWantedNext(made().nodes, request, kAll)) {
      const base::Aabb& box = made().nodes[next.node].box;
      if (base::Frustum(request.camera.clipFromScene()).mayOverlap(box) || next.motion <= 0.0F) continue;
      // The turn towards the box, and others.
      const glm::vec3 local(request.camera.eye_from_scene * glm::vec4(box.center(), 1.0F));
      const glm::vec3 towards = glm::normalize(glm::cross(local, glm::vec3(0.0F, 0.0F, -1.0F)));
      for (const glm::vec3& axis : {towards, glm::vec3(views.direction())}) {
        const TraverseRequest moved = turned(request, axis, 0.98F * next.motion);
        const glm::mat4 clip = moved.camera.clipFromScene();
        for (int corner = 0; corner < 8; ++corner) {
          const glm::vec4 p = clip * glm::vec4(box.corner(corner), 1.0F);
          ASSERT_FALSE(p.w > 0.0F && std::abs(p.x) <= p.w && std::abs(p.y) <= p.w);
        }
      }
      ++compared;
      const float whole = std::acos(glm::clamp(-local.z / glm::length(local), -1.0F, 1.0F));
      closest = std::min(closest, whole - next.motion);
    }
  }
  EXPECT_GT(compared, 1000);
  EXPECT_LT(closest, 0.5F);
}

TEST(HlodPrefetchTest, childrenOfDrawnNodesNeedTheStepThatBringsTheirErrorToTheTolerance) {
  TraverseRequest request = viewFrom(2.5, 500);
  request.tolerance = 3.0F;
  const std::map<std::uint32_t, float> motions = motionsOf(request);
  int children = 0;
  for (const std::uint32_t node : cutOf(request)) {
    const Node& row = made().nodes[node];
    for (std::uint32_t child = row.first_child; child < row.first_child + row.children; ++child) {
      if (!Sight(request).maySee(made().nodes[child])) continue;
      ++children;
      ASSERT_TRUE(motions.contains(child));
      const float step = 1.0F - projectedError(request.camera, row.box, row.error) / request.tolerance;
      EXPECT_NEAR(motions.at(child), step, 1e-5F);
    }
  }
  EXPECT_GT(children, 10);
}

TEST(HlodPrefetchTest, theFirstNodesByMotionAreGivenUpToABudget) {
  const TraverseRequest request = viewFrom(0.6, 500);
  const std::vector<NextNode> all = nodesWantedNext(made().nodes, request, kAll);
  ASSERT_GT(all.size(), 20U);
  for (std::size_t i = 1; i < all.size(); ++i) EXPECT_LE(all[i - 1].motion, all[i].motion);
  const std::vector<NextNode> some = nodesWantedNext(made().nodes, request, 30'000);
  ASSERT_GT(some.size(), 1U);
  std::uint64_t bytes = 0;
  for (std::size_t i = 0; i < some.size(); ++i) {
    EXPECT_EQ(some[i].node, all[i].node);
    bytes += made().nodes[some[i].node].picture.bytes;
  }
  EXPECT_LE(bytes, 30'000U);
  EXPECT_GT(bytes + made().nodes[all[some.size()].node].picture.bytes, 30'000U);
  EXPECT_TRUE(nodesWantedNext({}, request, kAll).empty());
}

TEST(HlodPrefetchTest, requestsAreTheSameWhereAllOfThemIs) {
  const TraverseRequest request = viewFrom(0.6, 500);
  TraverseRequest other = request;
  EXPECT_TRUE(isSameRequest(request, other));
  other.tolerance = 2.0F;
  EXPECT_FALSE(isSameRequest(request, other));
  other = request;
  other.tile = request.camera;
  EXPECT_FALSE(isSameRequest(request, other));
  EXPECT_TRUE(isSameRequest(other, TraverseRequest(other)));
  EXPECT_FALSE(isSameRequest(request, viewFrom(0.61, 500)));
}

// ---- streams ----

/// Answers all that a stream asks for, one after the other, until it asks for nothing.
void answerAll(Host& host, double& now) {
  for (int turn = 0; turn < 10'000; ++turn) {
    host.acceptRequests(now += 0.01);
    if (host.underWay() == 0) return;
    EXPECT_EQ(host.underWay(), 1U) << "more than one prefetch is under way";
    host.answerOne(now += 0.01);
  }
}

TEST(HlodPrefetchTest, aStreamFetchesNextNodesByMotionOnceItsViewIsComplete) {
  const TraverseRequest request = viewFrom(0.6, 500);
  StreamOptions options;
  options.prefetch_bytes = 60'000;
  Stream stream(made().file.size(), options);
  Host host(stream, made().file);
  double now = 0.0;
  fetchAll(stream, host, request, now);
  ASSERT_TRUE(stream.complete());
  while (host.underWay() > 0) host.answerOne(now += 0.01);
  const std::size_t asked = host.asked.size();
  EXPECT_EQ(stream.stats().prefetched_bytes, 0U) << "prefetches before the view is complete";
  const std::set<std::uint64_t> before = [&] {
    std::set<std::uint64_t> offsets;
    for (std::uint32_t node = 0; node < made().nodes.size(); ++node)
      for (const ByteRange& range : host.asked)
        if (made().nodes[node].picture.offset >= range.offset &&
            made().nodes[node].picture.offset + made().nodes[node].picture.bytes <= range.offset + range.length)
          offsets.insert(made().nodes[node].picture.offset);
    return offsets;
  }();

  const std::uint64_t generation = stream.generation();
  answerAll(host, now);
  EXPECT_EQ(stream.generation(), generation) << "the view is drawn anew for nothing";
  std::vector<std::uint64_t> expected;
  std::uint64_t bytes = 0;
  for (const NextNode& next : nodesWantedNext(made().nodes, request, kAll)) {
    const BlockPlace& place = made().nodes[next.node].picture;
    if (before.contains(place.offset)) continue;
    if (bytes + place.bytes > options.prefetch_bytes) break;
    bytes += place.bytes;
    expected.push_back(place.offset);
  }
  std::vector<std::uint64_t> offsets;
  for (std::size_t i = asked; i < host.asked.size(); ++i) offsets.push_back(host.asked[i].offset);
  EXPECT_EQ(offsets, expected);
  ASSERT_GT(offsets.size(), 3U);
  EXPECT_EQ(stream.stats().prefetched_bytes, bytes);

  // The same view again gets no more, another one does.
  std::vector<DrawnNode> drawn;
  stream.update(request, drawn);
  EXPECT_EQ(cutOf(request).size(), drawn.size());
  answerAll(host, now);
  EXPECT_EQ(stream.stats().prefetched_bytes, bytes);
  const TraverseRequest other = turned(request, glm::vec3(0.0F, 1.0F, 0.0F), 0.4F);
  fetchAll(stream, host, other, now);
  while (host.underWay() > 0) host.answerOne(now += 0.01);
  answerAll(host, now);
  EXPECT_GT(stream.stats().prefetched_bytes, bytes);
  EXPECT_LE(stream.stats().prefetched_bytes, 2 * options.prefetch_bytes);
}

TEST(HlodPrefetchTest, wantedNodesDoNotWait) {
  StreamOptions options;
  options.prefetch_bytes = 1'000'000;
  Stream stream(made().file.size(), options);
  Host host(stream, made().file);
  double now = 0.0;
  fetchAll(stream, host, viewFrom(0.6, 500), now);
  while (host.underWay() > 0) host.answerOne(now += 0.01);
  host.acceptRequests(now += 0.01);
  ASSERT_EQ(host.underWay(), 1U);
  // A new view comes while one of these is under way: what follows is all for the view, until it is complete.
  const TraverseRequest request = turned(viewFrom(0.6, 500), glm::vec3(0.0F, 1.0F, 0.0F), 1.2F);
  const std::uint64_t before = stream.stats().prefetched_bytes;
  std::vector<DrawnNode> drawn;
  for (int turn = 0; turn < 1000; ++turn) {
    stream.update(request, drawn);
    if (stream.complete()) break;
    host.acceptRequests(now += 0.01);
    EXPECT_EQ(stream.stats().prefetched_bytes, before);
    if (host.underWay() > 0) host.answerOne(now);
  }
  EXPECT_TRUE(stream.complete());
  EXPECT_EQ(drawn.size(), cutOf(request).size());
}

TEST(HlodPrefetchTest, moreNodesAreHereWhenAViewMovesThanWithoutIt) {
  std::map<std::uint64_t, StreamStats> stats;
  for (const std::uint64_t prefetch_bytes : {0, 400'000}) {
    StreamOptions options;
    options.prefetch_bytes = prefetch_bytes;
    Stream stream(made().file.size(), options);
    Host host(stream, made().file);
    double now = 0.0;
    StreamStats first;
    for (int i = 0; i < 20; ++i) {
      const TraverseRequest request =
          turned(viewFrom(1.0 - 0.02 * i, 500), glm::vec3(0.0F, 1.0F, 0.0F), -0.6F + 0.06F * static_cast<float>(i));
      fetchAll(stream, host, request, now);
      while (host.underWay() > 0) host.answerOne(now += 0.01);
      answerAll(host, now);
      if (i == 0) first = stream.stats();
    }
    stats[prefetch_bytes] = stream.stats();
    stats[prefetch_bytes].hits -= first.hits;
    stats[prefetch_bytes].misses -= first.misses;
  }
  const StreamStats &without = stats[0], &with = stats[400'000];
  EXPECT_EQ(without.prefetched_bytes, 0U);
  EXPECT_GT(without.misses, 50U);
  EXPECT_LT(2 * with.misses, without.misses);
  EXPECT_GT(with.hits, without.hits);
}

/// A view from a light above, of a square beside the middle.
LightRequest lightAt(float x, float size) {
  LightRequest light;
  light.camera.eye_from_scene = glm::lookAt(glm::vec3(x, 0.0F, 4.0F), glm::vec3(x, 0.0F, 0.0F), glm::vec3(0, 1, 0));
  light.camera.clip_from_eye = glm::ortho(-0.5F * size, 0.5F * size, -0.5F * size, 0.5F * size, 1.0F, 8.0F);
  light.camera.width = light.camera.height = 256;
  light.max_error = 1e-9F;
  return light;
}

TEST(HlodPrefetchTest, castersBesideALightsViewNeedTheStepThatBringsThemIntoIt) {
  const LightRequest light = lightAt(-0.5F, 0.8F);
  const std::vector<NextNode> next = castersWantedNext(made().nodes, light, kAll);
  ASSERT_GT(next.size(), 20U);
  const base::Frustum frustum(light.camera.clipFromScene());
  for (std::size_t i = 0; i < next.size(); ++i) {
    EXPECT_LE(next[i - std::min<std::size_t>(i, 1)].motion, next[i].motion);
    const Node& node = made().nodes[next[i].node];
    EXPECT_TRUE(node.isLeaf());
    EXPECT_FALSE(frustum.mayOverlap(node.box));
    // A step by less than that, in parts of the picture's height, does not show it.
    const LightRequest moved = lightAt(-0.5F + 0.8F * 0.98F * std::max(next[i].motion, 0.0F), 0.8F);
    EXPECT_TRUE(next[i].motion <= 0.0F || !base::Frustum(moved.camera.clipFromScene()).mayOverlap(node.box));
  }
  EXPECT_TRUE(castersWantedNext({}, light, kAll).empty());
}

TEST(HlodPrefetchTest, castersBehindAllReceiversAreNotWanted) {
  LightRequest light = lightAt(0.0F, 0.8F);
  const std::size_t all = castersWantedNext(made().nodes, light, kAll).size();
  // The light looks down from z = 4; the far plane cuts the model in its middle.
  const base::Aabb& model = made().nodes[0].box;
  const float cut = model.center().z;
  light.camera.clip_from_eye = glm::ortho(-0.4F, 0.4F, -0.4F, 0.4F, 1.0F, 4.0F - cut);
  const std::vector<NextNode> next = castersWantedNext(made().nodes, light, kAll);
  EXPECT_LT(next.size(), all);
  EXPECT_GT(next.size(), 0U);
  for (const NextNode& one : next) EXPECT_GE(made().nodes[one.node].box.max.z, cut - 1e-4F);
}

TEST(HlodPrefetchTest, castersOfAMovedLightAreHereThatWereFetchedAhead) {
  const TraverseRequest request = viewFrom(12.0, 300);  // coarse pictures
  std::map<bool, std::uint64_t> bytes;
  for (const bool is_ahead : {false, true}) {
    StreamOptions options;
    options.prefetch_bytes = is_ahead ? 10'000'000 : 0;
    Stream stream(made().file.size(), options);
    Host host(stream, made().file);
    double now = 0.0;
    fetchAll(stream, host, request, now);
    while (host.underWay() > 0) host.answerOne(now += 0.01);
    stream.expectLights({lightAt(-0.5F, 0.8F)});
    answerAll(host, now);
    const std::uint64_t before = stream.stats().bytes_received;
    std::vector<std::uint32_t> leaves;
    for (const NextNode& next : castersWantedNext(made().nodes, lightAt(-0.5F, 0.8F), kAll))
      leaves.push_back(next.node);
    std::vector<std::shared_ptr<const CasterPicture>> casters;
    std::vector<DrawnNode> drawn;
    for (int turn = 0; turn < 1000; ++turn) {
      stream.update(request, drawn);
      stream.updateCasters(leaves, casters);
      if (stream.complete()) break;
      host.acceptRequests(now += 0.01);
      if (host.underWay() > 0) host.answerOne(now);
    }
    EXPECT_TRUE(stream.complete());
    bytes[is_ahead] = stream.stats().bytes_received - before;
  }
  EXPECT_GT(bytes[false], 20'000U);
  EXPECT_LT(2 * bytes[true], bytes[false]);
}

TEST(HlodPrefetchTest, aThinLinkFetchesNothingAheadAndAnyOtherItsShare) {
  for (const bool is_thin : {false, true}) {
    StreamOptions options;
    options.prefetch_bytes = 10'000'000;
    options.prefetch_seconds = 0.5;
    options.prefetch_least_rate = is_thin ? 1e12 : 1.0;
    Stream stream(made().file.size(), options);
    Host host(stream, made().file);
    double now = 0.0;
    fetchAll(stream, host, viewFrom(0.6, 500), now);
    while (host.underWay() > 0) host.answerOne(now += 0.01);
    answerAll(host, now);
    const double rate = static_cast<double>(stream.stats().bytes_received) / now;
    const auto ahead = static_cast<double>(stream.stats().prefetched_bytes);
    EXPECT_EQ(ahead == 0.0, is_thin);
    EXPECT_LT(ahead, 10.0 * options.prefetch_seconds * rate);
  }
}

TEST(HlodPrefetchTest, nothingIsDroppedForIt) {
  StreamOptions options;
  options.memory_bytes = kMinStreamMemory;
  options.prefetch_bytes = 100'000'000;
  Stream stream(made().file.size(), options);
  Host host(stream, made().file);
  double now = 0.0;
  const TraverseRequest request = viewFrom(0.6, 500);
  const std::vector<DrawnNode> first = fetchAll(stream, host, request, now);
  ASSERT_TRUE(stream.complete());
  while (host.underWay() > 0) host.answerOne(now += 0.01);
  answerAll(host, now);
  EXPECT_GT(stream.stats().prefetched_bytes, 100'000U);
  EXPECT_LT(stream.stats().prefetched_bytes, kMinStreamMemory);
  EXPECT_LE(stream.stats().memory_bytes, kMinStreamMemory + 500 * made().nodes.size());
  std::vector<DrawnNode> again;
  stream.update(request, again);
  ASSERT_EQ(again.size(), first.size());
  for (std::size_t i = 0; i < again.size(); ++i) EXPECT_EQ(again[i].picture, first[i].picture);
}

}  // namespace
}  // namespace lod::hlod
