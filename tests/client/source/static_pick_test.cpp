// Full-resolution picks on a published scene find, by ranges only, what a server's /pick finds.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "lod/patch/ray_cast.h"
#include "tests/client/source/static_viewer.h"

namespace client {
namespace {

/// The scene lies far from the world's origin, where floats cannot resolve millimetres.
const glm::dvec3 kOrigin{500'000.25, 4'000'000.5, 100.0};

PublishedScene farAway(const server::TestScene& scene) {
  PublishedScene published(scene);
  published.scene.welcome.origin = kOrigin;
  return published;
}

/// Returns rays from above, from the side and past the square; world coordinates.
std::vector<lod::patch::Ray> someRays(const server::TestScene& scene, int count) {
  const glm::dvec3 low(scene.data.welcome.box_min);
  const glm::dvec3 size = glm::dvec3(scene.data.welcome.box_max) - low;
  std::mt19937 random(5);
  std::uniform_real_distribution<double> share(-0.1, 1.1);
  std::vector<lod::patch::Ray> rays;
  for (int i = 0; i < count; ++i) {
    lod::patch::Ray ray;
    const glm::dvec3 target = low + size * glm::dvec3(share(random), share(random), 0.5);
    ray.origin = low + size * glm::dvec3(share(random), share(random), 0.0) + glm::dvec3(0.0, 0.0, 0.02 * i * size.x);
    ray.origin.z += 3.0 * size.z;
    ray.direction = 7.0 * (target - ray.origin);
    ray.origin += kOrigin;
    rays.push_back(ray);
  }
  return rays;
}

PickAnswer answerTo(StaticViewer& viewer, std::uint32_t id, const lod::patch::Ray& ray) {
  viewer.source.pick(id, ray.origin, ray.direction);
  for (int i = 0; i < 2000; ++i) {
    viewer.pump();
    for (const AnsweredPick& answered : viewer.source.takePicks()) {
      EXPECT_EQ(answered.id, id);
      return answered.answer;
    }
  }
  ADD_FAILURE() << "no answer";
  return {};
}

/// Casts the ray at the whole file, which gives the true answer.
std::optional<lod::patch::RayHit> truth(const server::TestScene& scene, lod::patch::Ray ray) {
  ray.origin -= kOrigin;
  const auto cast = lod::patch::castRay(scene.patches->hierarchy(), ray, lod::patch::blocksOf(*scene.patches));
  EXPECT_TRUE(bool(cast));
  EXPECT_TRUE(cast->needed.empty());
  return cast->hit;
}

void expectTruth(const server::TestScene& scene, const lod::patch::Ray& ray, const PickAnswer& answer) {
  const auto expected = truth(scene, ray);
  ASSERT_EQ(answer.kind, expected ? PickAnswer::Kind::kHit : PickAnswer::Kind::kNone);
  if (!expected) return;
  EXPECT_LT(glm::length(answer.point - (kOrigin + expected->point)), 1e-9) << "doubles all the way";
  EXPECT_EQ(answer.normal, expected->front ? expected->normal : -expected->normal);
  EXPECT_EQ(answer.accuracy, scene.patches->hierarchy().lattice.step) << "of leaves";
}

TEST(StaticPick, findsWhatTheWholeFileHoldsWhateverIsShown) {
  const server::TestScene scene(32, 1'000);
  const PublishedScene published = farAway(scene);
  StaticViewer viewer(published);
  protocol::View far = scene.view(1, {0.0, 0.0, 3.0});
  far.camera.position += kOrigin;
  far.camera.width = far.camera.height = 16;
  ASSERT_TRUE(viewer.complete(far.camera)) << viewer.source.problem();
  ASSERT_LT(viewer.got.groups.size(), scene.patches->hierarchy().groups.size() / 2) << "shown coarsely";
  std::uint32_t id = 1;
  int hits = 0;
  for (const lod::patch::Ray& ray : someRays(scene, 40)) {
    const PickAnswer answer = answerTo(viewer, id++, ray);
    expectTruth(scene, ray, answer);
    hits += answer.kind == PickAnswer::Kind::kHit ? 1 : 0;
  }
  EXPECT_GT(hits, 15);
  EXPECT_LT(hits, 40);
  EXPECT_EQ(viewer.host.bytesRepeated(), 0U) << "the session keeps the blocks";
  EXPECT_EQ(viewer.source.problem(), "");
  ASSERT_TRUE(viewer.complete(far.camera));
}

TEST(StaticPick, readsOnlyWhatLiesAroundTheRay) {
  const server::TestScene scene(64, 1'000);
  const PublishedScene published = farAway(scene);
  StaticViewer viewer(published);
  protocol::View far = scene.view(1, {0.0, 0.0, 3.0});
  far.camera.position += kOrigin;
  far.camera.width = far.camera.height = 16;
  ASSERT_TRUE(viewer.complete(far.camera));
  viewer.rest();
  const std::size_t groups = viewer.got.groups.size();
  lod::patch::Ray down;
  down.origin = kOrigin + scene.center() + glm::dvec3(0.3, 0.2, 100.0);
  down.direction = {0.0, 0.0, -1.0};
  ASSERT_EQ(answerTo(viewer, 9, down).kind, PickAnswer::Kind::kHit);
  EXPECT_GT(viewer.got.groups.size(), groups);
  EXPECT_LT(viewer.got.groups.size() - groups, 20U) << "of " << scene.patches->hierarchy().groups.size();
  const std::size_t asked = viewer.host.requests.size();
  ASSERT_EQ(answerTo(viewer, 10, down).kind, PickAnswer::Kind::kHit);
  EXPECT_EQ(viewer.host.requests.size(), asked) << "it is here";
}

TEST(StaticPick, manyAtOnceAreAnsweredInTurnAndTooManyAtOnceNot) {
  const server::TestScene scene(16, 1'000);
  const PublishedScene published = farAway(scene);
  StaticViewer viewer(published);
  const auto rays = someRays(scene, static_cast<int>(RayPicks::kMaxQueue) + 3);
  for (std::uint32_t i = 0; i < rays.size(); ++i) viewer.source.pick(i, rays[i].origin, rays[i].direction);
  std::vector<AnsweredPick> answers;
  for (int i = 0; i < 5000 && answers.size() < rays.size(); ++i) {
    viewer.pump();
    for (const AnsweredPick& one : viewer.source.takePicks()) answers.push_back(one);
  }
  ASSERT_EQ(answers.size(), rays.size());
  for (const AnsweredPick& one : answers) {
    if (one.id >= RayPicks::kMaxQueue)
      EXPECT_EQ(one.answer.kind, PickAnswer::Kind::kUnknown);
    else
      expectTruth(scene, rays[one.id], one.answer);
  }
}

TEST(StaticPick, aSmallCacheAndAnEvictionCostNoAnswer) {
  const server::TestScene scene(32, 5'000);
  const PublishedScene published = farAway(scene);
  SessionOptions options = smallOptions();
  options.cache_bytes = 60'000;
  StaticViewer viewer(published, {}, options);
  protocol::View far = scene.view(1, {0.0, 0.0, 2.0});
  far.camera.position += kOrigin;
  ASSERT_TRUE(viewer.complete(far.camera));
  std::uint32_t id = 1;
  const auto rays = someRays(scene, 30);
  for (int round = 0; round < 2; ++round)
    for (const lod::patch::Ray& ray : rays) expectTruth(scene, ray, answerTo(viewer, id++, ray));
}

TEST(StaticPick, aHostThatIsAwayIsWaitedFor) {
  const server::TestScene scene(16, 1'000);
  const PublishedScene published = farAway(scene);
  StaticViewer viewer(published);
  protocol::View far = scene.view(1, {0.0, 0.0, 3.0});
  far.camera.position += kOrigin;
  far.camera.width = far.camera.height = 16;
  ASSERT_TRUE(viewer.complete(far.camera));
  viewer.rest();
  bool away = true;
  viewer.host.trouble = [&](const HostRequest&) -> std::optional<FetchOutcome> {
    return away ? std::optional(FetchOutcome::kNetwork) : std::nullopt;
  };
  lod::patch::Ray down;
  down.origin = kOrigin + scene.center() + glm::dvec3(3.3, 2.2, 100.0);
  down.direction = {0.0, 0.0, -1.0};
  viewer.source.pick(1, down.origin, down.direction);
  for (int i = 0; i < 300; ++i) viewer.pump();
  EXPECT_TRUE(viewer.source.takePicks().empty());
  away = false;
  std::vector<AnsweredPick> answers;
  for (int i = 0; i < 3000 && answers.empty(); ++i) {
    viewer.pump();
    answers = viewer.source.takePicks();
  }
  ASSERT_EQ(answers.size(), 1U);
  expectTruth(scene, down, answers[0].answer);
}

TEST(StaticPick, damageAndASceneThatIsGoneAreUnknown) {
  const server::TestScene scene(16, 1'000);
  PublishedScene damaged = farAway(scene);
  // Only blocks are damaged; the tables stay valid.
  base::Bytes& file = damaged.objects[damaged.scene.patches.name];
  const auto& hierarchy = scene.patches->hierarchy();
  for (std::size_t g = 1; g < hierarchy.groups.size(); ++g)
    for (std::uint32_t b = 0; b < hierarchy.groups[g].block_bytes; ++b)
      file[hierarchy.groups[g].block_offset + b] ^= 0xA5;
  lod::patch::Ray down;
  down.origin = kOrigin + scene.center() + glm::dvec3(0.3, 0.2, 100.0);
  down.direction = {0.0, 0.0, -1.0};
  StaticViewer viewer(damaged);
  EXPECT_EQ(answerTo(viewer, 1, down).kind, PickAnswer::Kind::kUnknown);
  EXPECT_NE(viewer.source.problem().find(damaged.scene.patches.name), std::string::npos) << viewer.source.problem();

  const PublishedScene sound = farAway(scene);
  StaticViewer gone(sound);
  gone.host.trouble = [](const HostRequest&) { return std::optional(FetchOutcome::kNotFound); };
  EXPECT_EQ(answerTo(gone, 2, down).kind, PickAnswer::Kind::kUnknown);
}

}  // namespace
}  // namespace client
