// Tests a published scene shown without a server: what arrives, in which order, and what happens when it does not.
#include "client/source/static_source.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "plan/coarse_sight.h"
#include "plan/opening_ranges.h"
#include "server/session/session.h"
#include "tests/client/source/static_viewer.h"
#include "tests/support/sample_points.h"

namespace client {
namespace {

using repository::FaceKey;

/// Returns the occlusion that a client knows that reads the scene by itself.
lod::patch::ProxySight coarseSightOf(const server::SceneData& data) {
  const lod::patch::Hierarchy& hierarchy = data.patches->hierarchy();
  base::Bytes block;
  auto sight =
      plan::makeCoarseSight(hierarchy, plan::coarseGroups(hierarchy, plan::kCoarseBytes),
                            [&](std::uint32_t group) -> base::ByteView { return block = *data.patches->block(group); });
  EXPECT_TRUE(sight && sight->triangleCount() > 0);
  return std::move(*sight);
}

/// A client of our own server, which knows no more about occlusion.
struct ServedViewer {
  explicit ServedViewer(const server::SceneData& scene, const SessionOptions& options = smallOptions())
      : sight(coarseSightOf(scene)), data(scene), server(data), session(options) {
    data.sight = &sight;
    session.connected();
  }
  Got complete(const base::ViewCamera& camera) {
    session.setView(camera);
    Got got;
    for (int i = 0; i < 100'000 && !session.complete(); ++i) {
      while (const auto bytes = session.nextToSend()) EXPECT_TRUE(server.receive(*bytes));
      if (const auto bytes = server.nextMessage()) {
        EXPECT_TRUE(session.receive(*bytes));
      }
      got.add(session.takeEvents());
    }
    EXPECT_TRUE(session.complete());
    return got;
  }
  const lod::patch::ProxySight sight;
  server::SceneData data;
  server::Session server;
  Session session;
};

std::vector<base::ViewCamera> pathOver(const server::TestScene& scene) {
  std::vector<base::ViewCamera> path;
  for (int i = 0; i < 6; ++i) {
    const double t = 0.3 * i;
    path.push_back(scene.view(1, {0.5 * std::cos(t), 0.5 * std::sin(t), 0.5 - 0.06 * i}, {0.1, 0.05 * i, 0.0}).camera);
  }
  return path;
}

/// The faces are of every kind: images, empty flags, some missing.
void makeHoles(server::TestScene& scene) {
  std::size_t n = 0;
  for (auto it = scene.store.values.begin(); it != scene.store.values.end(); ++n) {
    if (n % 7 == 0) it->second = repository::encodeFaceValue({});
    it = n % 11 == 0 ? scene.store.values.erase(it) : std::next(it);
  }
}

// ---- what comes ----

TEST(StaticSource, everyViewGetsWhatAServerSends) {
  server::TestScene scene(16, 3'000);
  makeHoles(scene);
  const PublishedScene published(scene);
  StaticViewer viewer(published);
  ServedViewer served(scene.data);
  for (const base::ViewCamera& camera : pathOver(scene)) {
    const Got expected = served.complete(camera);
    viewer.got = {};
    ASSERT_TRUE(viewer.complete(camera)) << viewer.source.problem();
    EXPECT_EQ(viewer.got.groups, expected.groups);
    EXPECT_EQ(viewer.got.faces, expected.faces);
  }
  EXPECT_GT(viewer.source.stats().missing, 0U);
  EXPECT_EQ(viewer.source.stats().broken, 0U);
  const protocol::Welcome& a = *viewer.session.welcome();
  const protocol::Welcome& b = *served.session.welcome();
  EXPECT_EQ(a.group_count, b.group_count);
  EXPECT_EQ(a.patch_count, b.patch_count);
  EXPECT_EQ(a.grid, b.grid);
}

TEST(StaticSource, imagesThatASmallModelGainsLittleByComeOnceTheEyeRests) {
  const server::FarScene scene;
  const PublishedScene published(scene);
  StaticViewer viewer(published);
  ASSERT_TRUE(viewer.complete(scene.camera())) << viewer.source.problem();
  const std::size_t first = viewer.got.faces.size();
  ASSERT_GT(first, 0U);
  ASSERT_TRUE(viewer.session.mayRefine());
  viewer.session.refine();
  ASSERT_TRUE(viewer.complete(scene.camera())) << viewer.source.problem();
  EXPECT_GT(viewer.got.faces.size(), first);
}

TEST(StaticSource, pagesOfTheTablesLeadToTheSameGroups) {
  const server::TestScene scene(32, 1'000);
  const PublishedScene published(scene);
  StaticViewer viewer(published);
  ServedViewer served(scene.data);
  Got all, expected_all;
  std::size_t shared = 0, wanted = 0;
  for (const base::ViewCamera& camera : pathOver(scene)) {
    const Got expected = served.complete(camera);
    viewer.got = {};
    ASSERT_TRUE(viewer.complete(camera)) << viewer.source.problem();
    all.groups.merge(viewer.got.groups);
    expected_all.groups.insert(expected.groups.begin(), expected.groups.end());
    for (const std::uint64_t face : expected.faces)
      shared += viewer.session.face(*FaceKey::fromCode(face)) != nullptr ? 1 : 0;
    wanted += expected.faces.size();
  }
  // Some images are chosen while finer groups are not known yet.
  EXPECT_GT(shared, wanted * 8 / 10);
  for (const std::uint32_t group : expected_all.groups) EXPECT_TRUE(viewer.session.hasGroup(group));
  EXPECT_LE(all.groups.size(), expected_all.groups.size());
  EXPECT_EQ(viewer.host.bytesRepeated(), 0U);
}

TEST(StaticSource, onlyTheRecordsThatAViewNeedsAreRead) {
  const server::TestScene scene(64, 1'000);
  const PublishedScene published(scene);
  StaticViewer viewer(published);
  protocol::View far = scene.view(1, {0.0, 0.0, 3.0});
  far.camera.width = 64;
  far.camera.height = 48;
  ASSERT_TRUE(viewer.complete(far.camera));
  EXPECT_LT(viewer.source.stats().record_bytes, published.scene.records.bytes / 3);
}

TEST(StaticSource, theOrderOfArrivalMakesNoDifference) {
  server::TestScene scene(16, 3'000);
  makeHoles(scene);
  const PublishedScene published(scene);
  ServedViewer served(scene.data);
  std::vector<Got> expected;  // until the end of each view
  for (const base::ViewCamera& camera : pathOver(scene)) {
    Got got = served.complete(camera);
    if (!expected.empty()) {
      got.groups.insert(expected.back().groups.begin(), expected.back().groups.end());
      got.faces.insert(expected.back().faces.begin(), expected.back().faces.end());
    }
    expected.push_back(std::move(got));
  }
  for (unsigned seed = 1; seed <= 5; ++seed) {
    StaticViewer viewer(published);
    viewer.host.random.emplace(seed);
    viewer.host.answers_a_take = 1;
    std::size_t at = 0;
    for (const base::ViewCamera& camera : pathOver(scene)) {
      ASSERT_TRUE(viewer.complete(camera));
      const Got& wanted = expected[at++];
      EXPECT_EQ(viewer.got.groups, wanted.groups) << "seed " << seed;
      EXPECT_TRUE(
          std::includes(viewer.got.faces.begin(), viewer.got.faces.end(), wanted.faces.begin(), wanted.faces.end()))
          << "seed " << seed;
      // A few that something hides may have come before the coarse model told so.
      EXPECT_LE(viewer.got.faces.size(), wanted.faces.size() + 3) << "seed " << seed;
    }
    EXPECT_EQ(viewer.host.bytesRepeated(), 0U);
  }
}

/// The ranges of images and of the index, but for its front, that were asked for before the coarse model was whole. An
/// answer comes each `seconds`.
std::size_t asksBeforeTheCoarseModel(const server::TestScene& scene, double seconds) {
  const PublishedScene published(scene);
  const lod::patch::Hierarchy& hierarchy = scene.data.patches->hierarchy();
  const std::vector<std::uint32_t> coarse = plan::coarseGroups(hierarchy, plan::kCoarseBytes);
  StaticViewer viewer(published);
  viewer.host.answers_a_take = 1;
  viewer.session.setView(pathOver(scene)[0]);
  const auto isWhole = [&] {
    return std::all_of(coarse.begin(), coarse.end(), [&](std::uint32_t g) { return viewer.session.hasGroup(g); });
  };
  std::size_t asked = 0;  // before the answer that makes it whole came
  for (int i = 0; i < 1000 && !isWhole(); ++i) {
    asked = viewer.host.requests.size();
    viewer.pump(seconds);
  }
  EXPECT_TRUE(isWhole());
  EXPECT_FALSE(viewer.session.complete());
  const auto first = viewer.host.requests.begin();
  return static_cast<std::size_t>(std::count_if(
      first, first + static_cast<std::ptrdiff_t>(asked),
      [](const HostRequest& request) { return request.name.starts_with("images/") && request.offset != 0; }));
}

TEST(StaticSource, imagesAreAskedForWhileTheCoarseModelComesUnlessTheLinkIsThin) {
  const server::TestScene scene(16, 3'000);
  EXPECT_GE(asksBeforeTheCoarseModel(scene, 0.002), 1U);
  EXPECT_EQ(asksBeforeTheCoarseModel(scene, 0.5), 0U);
}

TEST(StaticSource, somethingIsDrawnAfterOneRoundTrip) {
  const server::TestScene scene(64, 3'000);
  const PublishedScene published(scene);
  StaticViewer viewer(published);
  while (!viewer.session.hasGroup(0)) viewer.pump();
  EXPECT_EQ(viewer.host.round_trips, 1U);
  EXPECT_LT(viewer.host.bytes_sent, 40'000U);

  // All that follows is as without the named blocks, and each byte comes once.
  PublishedScene unnamed(scene);
  unnamed.scene.patches.opening.clear();
  StaticViewer other(unnamed);
  for (const base::ViewCamera& camera : pathOver(scene)) {
    ASSERT_TRUE(viewer.complete(camera));
    ASSERT_TRUE(other.complete(camera));
  }
  EXPECT_EQ(viewer.got.groups, other.got.groups);
  EXPECT_EQ(viewer.host.bytesRepeated(), 0U);
  EXPECT_EQ(other.host.bytesRepeated(), 0U);
}

TEST(StaticSource, theOrderInWhichTheFirstRangesComeMakesNoDifference) {
  const server::TestScene scene(64, 3'000);
  PublishedScene published(scene);
  // The test's own ranges: the coarsest blocks one by one.
  published.scene.patches.opening.clear();
  const lod::patch::Hierarchy& hierarchy = scene.patches->hierarchy();
  for (std::uint32_t group = 0; group < 5; ++group)
    published.scene.patches.opening.push_back(
        {hierarchy.groups[group].block_offset, hierarchy.groups[group].block_bytes});
  for (unsigned seed = 0; seed < 8; ++seed) {
    StaticViewer viewer(published);
    viewer.host.random.emplace(seed);
    viewer.host.answers_a_take = 1;
    EXPECT_TRUE(viewer.complete(pathOver(scene)[0])) << viewer.session.problem();
    EXPECT_EQ(viewer.host.bytesRepeated(), 0U);
  }
}

TEST(StaticSource, firstRangesThatCannotBeArePassedOver) {
  const server::TestScene scene(64, 3'000);
  PublishedScene published(scene);
  const std::uint64_t bytes = published.scene.patches.bytes;
  using Ranges = std::vector<base::FileRange>;
  for (const Ranges& opening : {Ranges{{0, 0}}, Ranges{{0, bytes + 1}}, Ranges{{0, 1024}, {bytes, 1}},
                                Ranges{{0, 1024}, {~std::uint64_t{0}, 2}}, Ranges(17, base::FileRange{0, 1024})}) {
    published.scene.patches.opening = opening;
    StaticViewer viewer(published);
    EXPECT_TRUE(viewer.complete(pathOver(scene)[0])) << viewer.session.problem();
    const auto& asked = viewer.host.requests;
    EXPECT_TRUE(std::none_of(asked.begin(), asked.end(), [](const auto& request) {
      return request.name.ends_with(".lgp") && request.offset == 0;
    }));
  }
  // These can be, and are of no use.
  published.scene.patches.opening = {{0, 1024}, {0, 1024}, {3, 5000}, {bytes - 1, 1}};
  StaticViewer viewer(published);
  EXPECT_TRUE(viewer.complete(pathOver(scene)[0])) << viewer.session.problem();
}

TEST(StaticSource, noByteIsAskedForTwice) {
  server::TestScene scene(16, 3'000);
  makeHoles(scene);
  const PublishedScene published(scene, 37);
  StaticViewer viewer(published);
  const auto path = pathOver(scene);
  for (const base::ViewCamera& camera : path) {
    ASSERT_TRUE(viewer.complete(camera));
    viewer.rest();
  }
  EXPECT_EQ(viewer.host.bytesRepeated(), 0U);
  const std::size_t asked = viewer.host.requests.size();
  for (const base::ViewCamera& camera : path) ASSERT_TRUE(viewer.complete(camera));
  EXPECT_EQ(viewer.host.requests.size(), asked) << "all of it is here";
  EXPECT_LE(viewer.host.most_under_way, 6U);
}

TEST(StaticSource, neighboursShareARequest) {
  const server::TestScene scene(16, 3'000);
  const PublishedScene published(scene, 1'000);
  StaticViewer viewer(published);
  ASSERT_TRUE(viewer.complete(pathOver(scene).front()));
  EXPECT_LT(viewer.host.requests.size(), viewer.got.faces.size() + viewer.got.groups.size());
}

TEST(StaticSource, anAdaptiveRepositoryIsReadByItsTree) {
  server::TestScene scene(16, 3'000);
  repository::SampleTree tree(scene.data.welcome.grid, 4);
  tree.split(tree.openLeaves().front());
  scene.data.tree = &tree;
  for (auto it = scene.store.values.begin(); it != scene.store.values.end();)
    it = support::hasPoint(tree, scene.data.welcome.grid, {it->first.x, it->first.y, it->first.z})
             ? std::next(it)
             : scene.store.values.erase(it);
  const PublishedScene published(scene, 100, &tree);
  StaticViewer viewer(published);
  ServedViewer served(scene.data);
  for (const base::ViewCamera& camera : pathOver(scene)) {
    const Got expected = served.complete(camera);
    viewer.got = {};
    ASSERT_TRUE(viewer.complete(camera)) << viewer.source.problem();
    EXPECT_EQ(viewer.got.faces, expected.faces);
  }
  EXPECT_EQ(viewer.source.stats().missing, 0U) << "faces of other points are not asked for";
}

TEST(StaticSource, aSceneWithoutImagesIsItsPatches) {
  const server::TestScene scene(16);
  PublishedScene published(scene);
  published.scene.index.reset();
  StaticViewer viewer(published);
  for (const base::ViewCamera& camera : pathOver(scene)) ASSERT_TRUE(viewer.complete(camera));
  EXPECT_TRUE(viewer.got.faces.empty());
  EXPECT_GT(viewer.got.groups.size(), 3U);
}

TEST(StaticSource, imagesCanBeSwitchedOffAndOn) {
  const server::TestScene scene(16, 3'000);
  const PublishedScene published(scene);
  StaticViewer viewer(published);
  const auto camera = pathOver(scene)[0];
  viewer.session.setView(camera);
  viewer.host.answers_a_take = 1;
  while (viewer.got.faces.size() < 2) viewer.pump();
  viewer.session.setWanted(false, false);
  ASSERT_TRUE(viewer.complete(camera));
  viewer.rest();
  EXPECT_EQ(viewer.session.phase(), SessionPhase::kReady) << viewer.session.problem();
  viewer.session.setWanted(true, false);
  ASSERT_TRUE(viewer.complete(camera));
  ServedViewer served(scene.data);
  for (const std::uint64_t face : served.complete(camera).faces) EXPECT_EQ(viewer.got.faces.count(face), 1U);
}

// ---- limits ----

TEST(StaticSource, aCacheSmallerThanAViewIsNotFilledForEver) {
  const server::TestScene scene(16, 20'000);
  const PublishedScene published(scene);
  SessionOptions options = smallOptions();
  options.cache_bytes = 300'000;
  StaticViewer viewer(published, {}, options);
  const auto path = pathOver(scene);
  ASSERT_TRUE(viewer.complete(path.front()));
  viewer.rest();
  const std::size_t asked = viewer.host.requests.size();
  for (int i = 0; i < 100; ++i) viewer.pump();
  EXPECT_EQ(viewer.host.requests.size(), asked) << "what was evicted waits for a view";

  // It is fetched again for the next view that needs it.
  for (const base::ViewCamera& camera : path) ASSERT_TRUE(viewer.complete(camera));
  const std::uint64_t before = viewer.host.bytesRepeated();
  ASSERT_TRUE(viewer.complete(path.front()));
  EXPECT_GT(viewer.host.bytesRepeated(), before);
  EXPECT_TRUE(viewer.session.hasGroup(0));
}

TEST(StaticSource, theNewestViewWins) {
  const server::TestScene scene(16, 20'000);
  const PublishedScene published(scene);
  StaticViewer viewer(published);
  const auto path = pathOver(scene);
  ASSERT_TRUE(viewer.complete(path[0]));
  viewer.rest();
  viewer.host.held = true;
  for (int i = 0; i < 40; ++i) {
    viewer.session.setView(scene.view(1, {0.01 * i, -0.4, 0.4}).camera);
    viewer.pump();
  }
  EXPECT_LE(viewer.host.waiting(), 6U);
  const std::size_t asked = viewer.host.requests.size();
  viewer.host.held = false;
  ServedViewer served(scene.data);
  const std::size_t needed = served.complete(path[4]).faces.size();
  ASSERT_TRUE(viewer.complete(path[4]));
  EXPECT_LE(viewer.host.requests.size() - asked, needed + 10) << "nothing of the 39 views between";
}

// ---- when it does not come ----

struct Trouble {
  FetchOutcome outcome;
  const char* words;
};
const Trouble kLastingTroubles[] = {
    {FetchOutcome::kForbidden, "may not be read"},   {FetchOutcome::kNotFound, "is not there"},
    {FetchOutcome::kRangeIgnored, "ignores Range"},  {FetchOutcome::kCompressed, "compresses"},
    {FetchOutcome::kChanged, "open the scene anew"}, {FetchOutcome::kTooShort, "publish the scene again"}};

// The failure meets any of the requests first.
TEST(StaticSource, lastingTroubleIsSaidInPlainWordsAtEveryStep) {
  const server::TestScene scene(16, 3'000);
  const PublishedScene published(scene);
  StaticViewer whole(published);
  ASSERT_TRUE(whole.complete(pathOver(scene)[0]));
  const std::size_t requests = whole.host.requests.size();
  ASSERT_GT(requests, 5U);
  for (const Trouble& trouble : kLastingTroubles) {
    for (std::size_t step = 1; step <= requests; ++step) {
      StaticViewer viewer(published);
      std::size_t seen = 0;
      std::string met;
      viewer.host.trouble = [&](const HostRequest& request) -> std::optional<FetchOutcome> {
        if (++seen != step) return std::nullopt;
        met = request.name;
        return trouble.outcome;
      };
      const bool done = viewer.complete(pathOver(scene)[0]);
      const std::string problem = viewer.source.problem();
      const std::string context = "step " + std::to_string(step) + ": " + problem;
      EXPECT_NE(problem.find(trouble.words), std::string::npos) << context;
      EXPECT_NE(problem.find("https://host/scene/" + met), std::string::npos) << context;
      if (repository::idOfPackName(met) && done) continue;  // the pack is lost, and the rest is shown
      EXPECT_FALSE(done) << context;
      EXPECT_EQ(viewer.session.phase(), SessionPhase::kRefused) << context;
      EXPECT_EQ(viewer.session.problem(), problem);
    }
  }
}

TEST(StaticSource, aLostPackIsMissedAndTheRestGoesOn) {
  const server::TestScene scene(16, 3'000);
  const PublishedScene published(scene, 50);
  StaticViewer viewer(published);
  ServedViewer served(scene.data);
  const auto camera = pathOver(scene)[0];
  const Got expected = served.complete(camera);
  std::string lost;
  viewer.host.trouble = [&](const HostRequest& request) -> std::optional<FetchOutcome> {
    if (lost.empty() && repository::idOfPackName(request.name)) lost = request.name;
    return request.name == lost ? std::optional(FetchOutcome::kNotFound) : std::nullopt;
  };
  ASSERT_TRUE(viewer.complete(camera));
  EXPECT_EQ(viewer.got.groups, expected.groups);
  EXPECT_LT(viewer.got.faces.size(), expected.faces.size());
  EXPECT_GT(viewer.got.faces.size(), 0U);
  EXPECT_NE(viewer.source.problem().find(lost), std::string::npos);
  std::size_t asked = 0;
  for (const HostRequest& request : viewer.host.requests) asked += request.name == lost ? 1 : 0;
  viewer.rest();
  for (const HostRequest& request : viewer.host.requests) asked -= request.name == lost ? 1 : 0;
  EXPECT_EQ(asked, 0U) << "nobody asks for it again";
}

TEST(StaticSource, aHostThatComesBackIsNoticed) {
  const server::TestScene scene(16, 3'000);
  const PublishedScene published(scene);
  StaticViewer viewer(published);
  const auto path = pathOver(scene);
  bool away = true;
  viewer.host.trouble = [&](const HostRequest&) -> std::optional<FetchOutcome> {
    return away ? std::optional(FetchOutcome::kNetwork) : std::nullopt;
  };
  // The host never answers.
  for (int i = 0; i < 2'000; ++i) viewer.pump();
  EXPECT_EQ(viewer.session.phase(), SessionPhase::kDisconnected);
  EXPECT_NE(viewer.session.problem().find("no answer"), std::string::npos);
  EXPECT_NE(viewer.session.problem().find("Access-Control-Allow-Origin"), std::string::npos);
  EXPECT_LT(viewer.host.requests.size(), 60U) << "in 20 s";

  // The host answers, stops in the middle of a view, and answers again.
  away = false;
  ASSERT_TRUE(viewer.complete(path[0]));
  away = true;
  viewer.session.setView(path[3]);
  for (int i = 0; i < 500; ++i) viewer.pump();
  EXPECT_EQ(viewer.session.phase(), SessionPhase::kDisconnected);
  EXPECT_TRUE(viewer.session.hasGroup(0)) << "what is here can be looked at";
  away = false;
  ASSERT_TRUE(viewer.complete(path[3]));
  EXPECT_EQ(viewer.session.phase(), SessionPhase::kReady);
  EXPECT_EQ(viewer.host.bytesRepeated(), 0U) << "what was kept is not asked for again";
}

TEST(StaticSource, oneFailedRequestIsNoNews) {
  const server::TestScene scene(16, 3'000);
  const PublishedScene published(scene);
  for (const FetchOutcome outcome : {FetchOutcome::kNetwork, FetchOutcome::kServer}) {
    for (std::size_t step = 1; step < 12; ++step) {
      StaticViewer viewer(published);
      std::size_t seen = 0;
      viewer.host.trouble = [&](const HostRequest&) -> std::optional<FetchOutcome> {
        return ++seen == step ? std::optional(outcome) : std::nullopt;
      };
      ASSERT_TRUE(viewer.complete(pathOver(scene)[0])) << step;
      EXPECT_EQ(viewer.source.problem(), "");
    }
  }
}

// ---- damage ----

TEST(StaticSource, flippedBytesAreNoticedAndNamed) {
  const server::TestScene scene(16, 3'000);
  const PublishedScene sound(scene);
  std::mt19937 random(7);
  for (int round = 0; round < 150; ++round) {
    PublishedScene published = sound;
    auto it = published.objects.begin();
    std::advance(it, random() % published.objects.size());
    // Damage lies near the front, where headers and tables are, or anywhere.
    const std::size_t at =
        random() % (round % 2 == 0 ? std::min<std::size_t>(it->second.size(), 40'000) : it->second.size());
    it->second[at] ^= static_cast<std::uint8_t>(1U << (random() % 8));
    StaticViewer viewer(published);
    for (const base::ViewCamera& camera : pathOver(scene)) {
      const bool done = viewer.complete(camera);
      if (!done) {
        EXPECT_EQ(viewer.session.phase(), SessionPhase::kRefused);
      }
      if (viewer.session.phase() == SessionPhase::kRefused) {
        EXPECT_NE(viewer.session.problem().find("https://host/scene"), std::string::npos);
        break;
      }
    }
  }
}

TEST(StaticSource, aDamagedFaceOrIndexBlockCostsItsImagesOnly) {
  const server::TestScene scene(16, 3'000);
  PublishedScene published(scene);
  for (auto& [name, bytes] : published.objects) {
    if (name == published.indexName()) bytes[16'384 + 100] ^= 1;
  }
  StaticViewer viewer(published);
  ASSERT_TRUE(viewer.complete(pathOver(scene)[0]));
  EXPECT_NE(viewer.source.problem().find("block 0"), std::string::npos) << viewer.source.problem();
  EXPECT_GT(viewer.source.stats().broken, 0U);

  PublishedScene other(scene);
  for (const std::string& name : other.packNames()) other.objects[name][64 + 1'000] ^= 1;
  StaticViewer second(other);
  for (const base::ViewCamera& camera : pathOver(scene)) ASSERT_TRUE(second.complete(camera));
  EXPECT_GT(second.got.faces.size(), 10U);
}

TEST(StaticSource, damagedRecordsAreRefusedOrLeftOut) {
  const server::TestScene scene(64, 1'000);
  PublishedScene published(scene);
  base::Bytes& records = published.objects[published.scene.records.name];
  const base::Bytes whole = records;
  records[40] ^= 1;
  StaticViewer refused(published);
  EXPECT_FALSE(refused.complete(pathOver(scene)[0]));
  EXPECT_NE(refused.session.problem().find("damaged; publish the scene again"), std::string::npos)
      << refused.session.problem();

  // A chunk behind the first ones: what it would refine stays as it is.
  records = whole;
  records[records.size() - 100] ^= 1;
  SessionOptions leaves = smallOptions();
  leaves.setPatchTolerance(0.0F);
  StaticViewer viewer(published, {}, leaves);
  for (const base::ViewCamera& camera : pathOver(scene)) ASSERT_TRUE(viewer.complete(camera));
  EXPECT_NE(viewer.source.problem().find(".lgr: chunk"), std::string::npos) << viewer.source.problem();
  EXPECT_GT(viewer.source.stats().broken, 0U);
  EXPECT_GT(viewer.got.groups.size(), 10U);
}

TEST(StaticSource, refusesWrongEntriesOfSceneJson) {
  const server::TestScene scene(8);
  const auto refused = [&](const std::function<void(PublishedScene&)>& change, const std::string& words) {
    PublishedScene published(scene);
    change(published);
    StaticViewer viewer(published);
    EXPECT_FALSE(viewer.complete(pathOver(scene)[0]));
    EXPECT_NE(viewer.session.problem().find(words), std::string::npos) << viewer.session.problem();
  };
  refused([](PublishedScene& p) { p.scene.patches.name = "../../secret"; }, "lumigrid publish");
  refused([](PublishedScene& p) { p.scene.patches.name = "patch.lgp"; }, "lumigrid publish");
  refused([](PublishedScene& p) { p.scene.index->name = "https://elsewhere/x"; }, "lumigrid publish");
  refused([](PublishedScene& p) { p.scene.patches.bytes = 0; }, "lumigrid publish");
  refused([](PublishedScene& p) { p.scene.patches.bytes -= 1; }, "not as long as scene.json says");
  refused([](PublishedScene& p) { p.scene.index->bytes -= 1; }, "not as long as scene.json says");
  refused([](PublishedScene& p) { p.scene.patches.bytes = std::uint64_t{1} << 62; }, "publish");
  refused([](PublishedScene& p) { p.scene.records = {}; }, "an earlier program published this scene");
  refused([](PublishedScene& p) { p.scene.records.name = "records.lgr"; }, "lumigrid publish");
  refused([](PublishedScene& p) { p.scene.records.bytes -= 1; }, "lumigrid publish");
  refused([](PublishedScene& p) { p.scene.records.opening.clear(); }, "lumigrid publish");
  refused([](PublishedScene& p) { p.scene.records.opening[0].offset = 1; }, "lumigrid publish");
  refused([](PublishedScene& p) { p.scene.records.opening[0].length = 90; }, "publish the scene again");
  refused([](PublishedScene& p) { p.scene.index->opening.clear(); }, "publish the scene again");
  refused([](PublishedScene& p) { p.scene.index->opening[0].offset = 1; }, "publish the scene again");
  refused([](PublishedScene& p) { --p.scene.index->opening[0].length; }, "publish the scene again");
  refused([](PublishedScene& p) { ++p.scene.index->opening[0].length; }, "publish the scene again");
}

}  // namespace
}  // namespace client
