#include "server/session/session.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <set>

#include "plan/view_plan.h"
#include "tests/server/session/talk.h"

namespace server {
namespace {

// ---- greeting ----

TEST(Session, welcomeDescribesTheScene) {
  const TestScene scene;
  Talk talk(scene.data);
  EXPECT_FALSE(talk.next());
  ASSERT_TRUE(talk.say(protocol::Hello{protocol::kVersion, "test 1"}));
  const auto welcome = std::get<protocol::Welcome>(*talk.next());
  EXPECT_EQ(welcome.scene_name, "synthetic");
  EXPECT_EQ(welcome.grid, scene.data.welcome.grid);
  EXPECT_EQ(welcome.group_count, scene.data.welcome.group_count);
  EXPECT_EQ(talk.session.clientName(), "test 1");
  EXPECT_FALSE(talk.next()) << "nothing is sent before a view, for Holdings may come first";
}

TEST(Session, anotherVersionIsRefusedInPlainWords) {
  const TestScene scene;
  Talk talk(scene.data);
  auto taken = talk.say(protocol::Hello{7, ""});
  ASSERT_FALSE(taken);
  EXPECT_EQ(taken.error().code, base::ErrorCode::kVersion);
  EXPECT_FALSE(talk.session.finished());
  const auto refusal = std::get<protocol::Refusal>(*talk.next());
  EXPECT_EQ(refusal.version, protocol::kVersion);
  EXPECT_EQ(refusal.reason, "this server speaks protocol " + std::to_string(protocol::kVersion) +
                                ", the client speaks 7; update the server");
  EXPECT_TRUE(talk.session.finished());
  EXPECT_FALSE(talk.next());

  Talk old(scene.data);
  EXPECT_EQ(
      old.say(protocol::Hello{0, ""}).error().message,
      "this server speaks protocol " + std::to_string(protocol::kVersion) + ", the client speaks 0; update the client");
}

TEST(Session, sceneWithoutPatchesIsRefusedAndSaysWhatItHas) {
  for (const auto& [instead, method] : {std::pair(protocol::Streamed::kSplats, "--method qsplat"),
                                        {protocol::Streamed::kUmbrellas, "--method pmr"},
                                        {protocol::Streamed::kHlod, "--method hlod"}}) {
    SceneData data;
    data.instead = instead;
    Talk talk(data);
    const auto taken = talk.say(protocol::Hello{protocol::kVersion, "test 1"});
    ASSERT_FALSE(taken);
    EXPECT_EQ(taken.error().code, base::ErrorCode::kUnsupported);
    const auto refusal = std::get<protocol::Refusal>(*talk.next());
    EXPECT_EQ(refusal.instead, instead);
    EXPECT_EQ(refusal.reason, taken.error().message);
    EXPECT_NE(refusal.reason.find(method), std::string::npos) << refusal.reason;
    EXPECT_TRUE(talk.session.finished());
  }
}

TEST(Session, messagesBeforeHelloAreRefused) {
  const TestScene scene;
  for (const protocol::ClientMessage& early :
       {protocol::ClientMessage(scene.view(1, kAbove)), protocol::ClientMessage(protocol::Holdings{})}) {
    Talk talk(scene.data);
    EXPECT_FALSE(talk.say(early));
    EXPECT_TRUE(std::holds_alternative<protocol::Refusal>(*talk.next()));
    EXPECT_TRUE(talk.session.finished());
  }
}

TEST(Session, secondHelloIsRefused) {
  const TestScene scene;
  Talk talk(scene.data);
  talk.greet();
  EXPECT_FALSE(talk.say(protocol::Hello{}));
  EXPECT_TRUE(std::holds_alternative<protocol::Refusal>(*talk.next()));
}

TEST(Session, garbageIsRefusedAndNothingFollows) {
  const TestScene scene;
  Talk talk(scene.data);
  talk.greet();
  ASSERT_TRUE(talk.say(scene.view(1, kAbove)));
  EXPECT_FALSE(talk.session.receive(base::Bytes{0x55, 1, 2, 3}));
  EXPECT_TRUE(std::holds_alternative<protocol::Refusal>(*talk.next()));
  EXPECT_FALSE(talk.next());
  EXPECT_TRUE(talk.session.finished());
  EXPECT_FALSE(talk.say(scene.view(2, kAbove)));
}

// ---- what a view is sent ----

TEST(Session, rootComesFirstAndParentsBeforeChildren) {
  const TestScene scene;
  Talk talk(scene.data);
  talk.greet();
  ASSERT_TRUE(talk.say(scene.view(1, kAbove)));
  const auto groups = groupsIn(scene.data, talk.drain());
  ASSERT_GT(groups.size(), 4U);
  EXPECT_EQ(groups[0], 0U);
  std::set<std::uint32_t> sent;
  for (std::uint32_t group : groups) {
    for (std::uint32_t parent : scene.patches->hierarchy().parentsOf(group))
      EXPECT_TRUE(sent.count(parent)) << parent << " before " << group;
    sent.insert(group);
  }
}

TEST(Session, nothingIsSentTwice) {
  const TestScene scene;
  Talk talk(scene.data);
  talk.greet();
  std::vector<ServerMessage> all;
  for (std::uint32_t i = 1; i <= 6; ++i) {
    ASSERT_TRUE(talk.say(scene.view(i, kAbove + glm::dvec3(0.05 * i, 0.02 * i, -0.08 * i))));
    for (auto& message : talk.drain(i % 2 == 0 ? 7 : 10'000)) all.push_back(std::move(message));
  }
  EXPECT_GT(facesIn(all).size(), 20U);
  EXPECT_TRUE(unique(facesIn(all)));
  EXPECT_TRUE(unique(groupsIn(scene.data, all)));
}

TEST(Session, completionComesOnceAfterEverythingThatTheViewNeeds) {
  const TestScene scene;
  Talk talk(scene.data);
  talk.greet();
  const protocol::View view = scene.view(5, kAbove);
  ASSERT_TRUE(talk.say(view));
  const auto messages = talk.drain();
  const std::size_t at = completeAt(messages, 5);
  ASSERT_LT(at, messages.size());

  const plan::ViewPlan plan = plan::planView(scene.data.toPlan(), view);
  const auto faces = facesIn(before(messages, at));
  const auto groups = groupsIn(scene.data, before(messages, at));
  ASSERT_FALSE(plan.faces.empty());
  for (const auto& key : plan.faces) EXPECT_EQ(std::count(faces.begin(), faces.end(), key), 1);
  for (std::uint32_t group : plan.groups) EXPECT_EQ(std::count(groups.begin(), groups.end(), group), 1);
  EXPECT_EQ(std::count_if(messages.begin(), messages.end(),
                          [](const auto& m) { return std::holds_alternative<protocol::Completion>(m); }),
            1);
}

TEST(Session, theSameViewAgainIsCompleteAtOnce) {
  const TestScene scene;
  Talk talk(scene.data);
  talk.greet();
  ASSERT_TRUE(talk.say(scene.view(1, kAbove)));
  talk.drain();
  ASSERT_TRUE(talk.say(scene.view(2, kAbove)));
  EXPECT_EQ(std::get<protocol::Completion>(*talk.next()).sequence, 2U);
}

TEST(Session, newViewDropsUnsentDataOfTheOldOne) {
  const TestScene scene(16);
  Talk talk(scene.data);
  talk.greet();
  const protocol::View left = scene.view(1, {-0.45, 0.0, 0.15}, {-0.45, 0.0, 0.0});
  const protocol::View right = scene.view(2, {0.45, 0.0, 0.15}, {0.45, 0.0, 0.0});
  ASSERT_TRUE(talk.say(left));
  talk.drain(3);
  ASSERT_TRUE(talk.say(right));
  const auto messages = talk.drain();
  const auto sent = before(messages, completeAt(messages, 2));

  const plan::ViewPlan wanted = plan::planView(scene.data.toPlan(), right);
  for (const auto& key : facesIn(sent))
    EXPECT_NE(std::find(wanted.faces.begin(), wanted.faces.end(), key), wanted.faces.end());
  const auto coarse = plan::coarseGroups(scene.patches->hierarchy(), plan::kCoarseBytes);
  for (std::uint32_t group : groupsIn(scene.data, sent))
    EXPECT_TRUE(std::count(wanted.groups.begin(), wanted.groups.end(), group) ||
                std::count(coarse.begin(), coarse.end(), group))
        << group;
  EXPECT_EQ(completeAt(messages, 1), messages.size()) << "the old view is never complete";
}

TEST(Session, onlyTheNewestOfManyViewsIsServed) {
  const TestScene scene;
  Talk talk(scene.data);
  talk.greet();
  for (std::uint32_t i = 1; i <= 50; ++i) ASSERT_TRUE(talk.say(scene.view(i, kAbove)));
  const auto messages = talk.drain();
  EXPECT_LT(completeAt(messages, 50), messages.size());
  for (std::uint32_t i = 1; i < 50; ++i) EXPECT_EQ(completeAt(messages, i), messages.size());
}

TEST(Session, groupsStayWithinTheTriangleBudget) {
  const TestScene scene(16);
  protocol::View view = scene.view(1, kAbove);
  view.patch_tolerance_px = 0.0F;
  const std::size_t all = plan::planView(scene.data.toPlan(), view).groups.size();
  view.max_triangles = 600;
  const std::size_t few = plan::planView(scene.data.toPlan(), view).groups.size();
  EXPECT_LT(few, all / 2);
  EXPECT_GE(few, 1U);
}

TEST(Session, noImagesAreSentToAClientThatWantsNone) {
  const TestScene scene;
  Talk talk(scene.data);
  talk.greet();
  protocol::View view = scene.view(1, kAbove);
  view.max_points = 0;
  ASSERT_TRUE(talk.say(view));
  const auto messages = talk.drain();
  EXPECT_TRUE(facesIn(messages).empty());
  EXPECT_LT(completeAt(messages, 1), messages.size());
}

TEST(Session, webpImagesAndHullsAreSentToThoseWhoTakeThem) {
  for (const std::uint8_t abilities : {std::uint8_t{0}, protocol::kDecodesWebp, protocol::kTakesHull}) {
    TestScene scene;
    scene.data.images_are_webp = true;
    scene.data.welcome.hull = {{1, 2, 3}};
    Talk talk(scene.data);
    ASSERT_TRUE(talk.say(protocol::Hello{protocol::kVersion, "test 1", abilities}));
    ASSERT_TRUE(talk.say(scene.view(1, kAbove)));
    const auto messages = talk.drain();
    EXPECT_EQ(facesIn(messages).empty(), abilities != protocol::kDecodesWebp);
    EXPECT_EQ(std::get<protocol::Welcome>(messages.at(0)).hull.empty(), abilities != protocol::kTakesHull);
    EXPECT_LT(completeAt(messages, 1), messages.size());
  }
}

TEST(Session, sceneWithoutImagesStillCompletes) {
  TestScene scene;
  scene.data.images = nullptr;
  scene.data.welcome.grid = {};
  Talk talk(scene.data);
  talk.greet();
  ASSERT_TRUE(talk.say(scene.view(1, kAbove)));
  const auto messages = talk.drain();
  EXPECT_FALSE(groupsIn(scene.data, messages).empty());
  EXPECT_LT(completeAt(messages, 1), messages.size());
}

TEST(Session, lookingAwayNeedsNoFaces) {
  const TestScene scene;
  Talk talk(scene.data);
  talk.greet();
  ASSERT_TRUE(talk.say(scene.view(1, {0.0, 0.0, 0.9}, {0.0, 0.0, 5.0})));
  const auto messages = talk.drain();
  EXPECT_TRUE(facesIn(messages).empty());
  EXPECT_LT(completeAt(messages, 1), messages.size());
}

TEST(Session, missingAndCorruptFacesAreSkipped) {
  TestScene scene;
  const protocol::View view = scene.view(1, kAbove);
  const plan::ViewPlan plan = plan::planView(scene.data.toPlan(), view);
  ASSERT_GE(plan.faces.size(), 3U);
  scene.store.values.erase(plan.faces[0]);
  scene.store.values[plan.faces[1]][100] ^= 1;
  Talk talk(scene.data);
  talk.greet();
  ASSERT_TRUE(talk.say(view));
  const auto messages = talk.drain();
  const auto faces = facesIn(before(messages, completeAt(messages, 1)));
  EXPECT_EQ(faces.size(), plan.faces.size() - 2);
  EXPECT_EQ(std::count(faces.begin(), faces.end(), plan.faces[0]), 0);
  EXPECT_EQ(std::count(faces.begin(), faces.end(), plan.faces[1]), 0);
  EXPECT_GE(talk.session.counts().missing, 1U);
  EXPECT_GE(talk.session.counts().corrupt, 1U);
  EXPECT_LT(completeAt(messages, 1), messages.size());
}

// The file is damaged, then cut, while a viewer looks: no such group is sent, and each is reported.
TEST(Session, damagedAndCutGroupsAreNeverSent) {
  TestScene scene;
  std::vector<std::string> reported;
  scene.data.on_read_error = [&](const base::Error& error) { reported.push_back(error.message); };
  const protocol::View view = scene.view(1, kAbove);
  const auto wanted = plan::planView(scene.data.toPlan(), view).groups;
  ASSERT_GE(wanted.size(), 2U);
  const lod::patch::Group& last = scene.patches->hierarchy().groups[wanted.back()];
  const auto flipByte = [&] {
    std::fstream file(scene.path, std::ios::in | std::ios::out | std::ios::binary);
    file.seekg(static_cast<std::streamoff>(last.block_offset + last.block_bytes - 1));
    const int byte = file.get();
    file.seekp(static_cast<std::streamoff>(last.block_offset + last.block_bytes - 1));
    file.put(static_cast<char>(byte ^ 1));
  };
  const auto sent = [&] {
    Talk talk(scene.data);
    talk.greet();
    EXPECT_TRUE(talk.say(view));
    const auto messages = talk.drain();
    EXPECT_LT(completeAt(messages, 1), messages.size());
    EXPECT_EQ(talk.session.counts().corrupt > 0, !reported.empty());
    return talk.session.counts().groups;
  };
  const std::uint64_t all = sent();
  EXPECT_TRUE(reported.empty());

  flipByte();
  EXPECT_LT(sent(), all);
  ASSERT_FALSE(reported.empty());
  EXPECT_NE(reported[0].find(scene.path + ": patch "), std::string::npos) << reported[0];
  EXPECT_NE(reported[0].find("checksum"), std::string::npos) << reported[0];
  flipByte();
  reported.clear();
  EXPECT_EQ(sent(), all) << "it was mended";

  std::filesystem::resize_file(scene.path, 0);
  EXPECT_EQ(sent(), 0U);
  EXPECT_NE(reported.at(0).find(scene.path + ": ends at byte"), std::string::npos) << reported[0];
}

TEST(Session, imagesThatASmallModelGainsLittleByComeOnceTheEyeRests) {
  const FarScene scene;
  Talk talk(scene.data);
  talk.greet();
  protocol::View view;
  view.camera = scene.camera();
  view.patch_tolerance_px = 1.0F;
  std::array<std::size_t, 2> faces{};
  for (std::uint32_t i = 0; i < 2; ++i) {
    view.sequence = i + 1;
    ASSERT_TRUE(talk.say(view));
    const auto messages = talk.drain();
    faces[i] = facesIn(before(messages, completeAt(messages, i + 1))).size();
  }
  EXPECT_GT(faces[0], 0U);
  EXPECT_GT(faces[1], 0U) << "what was not worth its bytes before";
}

// ---- what the client holds ----

TEST(Session, evictedDataComesAgainWithTheNextView) {
  const TestScene scene;
  Talk talk(scene.data);
  talk.greet();
  ASSERT_TRUE(talk.say(scene.view(1, kAbove)));
  const auto first = talk.drain();
  const auto faces = facesIn(before(first, completeAt(first, 1)));
  ASSERT_FALSE(faces.empty());
  ASSERT_TRUE(talk.say(protocol::Eviction{{faces[0]}, {0}}));
  EXPECT_FALSE(talk.next()) << "not before the next view asks for it";
  ASSERT_TRUE(talk.say(scene.view(2, kAbove)));
  const auto second = talk.drain();
  EXPECT_EQ(facesIn(before(second, completeAt(second, 2))), std::vector{faces[0]});
  EXPECT_EQ(groupsIn(scene.data, second), std::vector<std::uint32_t>{0});
}

TEST(Session, heldDataIsNotSent) {
  const TestScene scene;
  const protocol::View view = scene.view(1, kAbove);
  const plan::ViewPlan plan = plan::planView(scene.data.toPlan(), view);
  Talk talk(scene.data);
  talk.greet();
  ASSERT_TRUE(talk.say(protocol::Holdings{plan.faces, plan.groups}));
  for (std::uint32_t group : plan::coarseGroups(scene.patches->hierarchy(), plan::kCoarseBytes))
    ASSERT_TRUE(talk.say(protocol::Holdings{{}, {group}}));
  ASSERT_TRUE(talk.say(view));
  EXPECT_EQ(std::get<protocol::Completion>(*talk.next()).sequence, 1U);
}

TEST(Session, keysOfAnotherSceneAreIgnored) {
  const TestScene scene;
  Talk talk(scene.data);
  talk.greet();
  EXPECT_TRUE(talk.say(protocol::Holdings{{{9999, 0, 0, 0}}, {0xFFFFFFFF}}));
  EXPECT_TRUE(talk.say(protocol::Eviction{{{9999, 0, 0, 0}}, {0xFFFFFFFF}}));
}

TEST(Session, claimedHoldingsAreLimited) {
  TestScene scene;
  scene.data.welcome.grid.count = glm::uvec3(64);
  Talk talk(scene.data);
  talk.greet();
  std::size_t claimed = 0;
  bool refused = false;
  while (!refused && claimed < 2 * kMaxFacesHeld) {
    protocol::Holdings have;
    for (std::size_t i = 0; i < protocol::kMaxKeysPerMessage; ++i, ++claimed) {
      const auto n = static_cast<std::uint32_t>(claimed);
      have.faces.push_back({n / 6 % 64, n / 384 % 64, n / 24576 % 64, n % 6});
    }
    refused = !talk.say(have);
  }
  EXPECT_TRUE(refused);
  EXPECT_LE(claimed, kMaxFacesHeld + protocol::kMaxKeysPerMessage);
}

// ---- access counts ----

TEST(Session, onlySentDataIsCounted) {
  TestScene scene;
  repository::AccessCounter counter;
  scene.data.access = &counter;
  std::map<repository::FaceKey, std::uint64_t> faces;
  std::map<std::uint32_t, std::uint64_t> groups;
  for (int viewer = 0; viewer < 3; ++viewer) {
    Talk talk(scene.data);
    talk.greet();
    ASSERT_TRUE(talk.say(scene.view(1, kAbove)));
    const auto messages = talk.drain(viewer == 0 ? 7 : 10'000);  // the first one leaves in the middle
    for (const auto& key : facesIn(messages)) ++faces[key];
    for (const std::uint32_t group : groupsIn(scene.data, messages)) ++groups[group];
  }
  const auto counts = counter.takeCounts();
  EXPECT_EQ((std::map<repository::FaceKey, std::uint64_t>(counts.faces.begin(), counts.faces.end())), faces);
  EXPECT_EQ((std::map<std::uint32_t, std::uint64_t>(counts.groups.begin(), counts.groups.end())), groups);
  EXPECT_GT(faces.size(), 8U);
}

// ---- at rest ----

// After Completion come the faces of other directions at the view's points, then those along the motion; no others,
// none twice, in the plan's order, until the limit is reached.
TEST(Session, prefetchIsOtherDirectionsThenTheMotionAndLimited) {
  constexpr std::uint64_t kTwoFaces = 100'000, kAllFaces = 100'000'000;
  for (const std::uint64_t limit : {kTwoFaces, kAllFaces}) {
    TestScene scene(8, 60'000);
    scene.data.ahead_bytes = limit;
    Talk talk(scene.data);
    talk.greet();
    const protocol::View old_view = scene.view(1, kAbove);
    ASSERT_TRUE(talk.say(old_view));
    std::set<repository::FaceKey> held;
    plan::Holdings present;
    present.face = [&](const repository::FaceKey& key) { return held.count(key) != 0; };
    const auto hold = [&](const std::vector<repository::FaceKey>& faces) { held.insert(faces.begin(), faces.end()); };
    hold(facesIn(talk.drain(40)));  // a viewer that moves on soon, so that much is left to prefetch

    const protocol::View view = scene.view(2, kAbove + glm::dvec3(0.1, 0.0, 0.0));
    ASSERT_TRUE(talk.say(view));
    const plan::ViewPlan plan = plan::planView(scene.data.toPlan(), view, present);
    const auto messages = talk.drain();
    const std::size_t complete = completeAt(messages, 2);
    ASSERT_LT(complete, messages.size());
    hold(facesIn(before(messages, complete)));

    std::vector<repository::FaceKey> expected;
    const auto expect = [&](const std::vector<repository::FaceKey>& faces) {
      for (const repository::FaceKey& key : faces)
        if (!present.face(key) && std::find(expected.begin(), expected.end(), key) == expected.end())
          expected.push_back(key);
    };
    expect(plan.other_faces);
    ASSERT_GT(expected.size(), 1U);
    expect(plan::planMotion(scene.data.toPlan(), view, old_view, present));

    if (limit == kTwoFaces) expected.erase(expected.begin() + 2, expected.end());

    std::vector<repository::FaceKey> prefetched;
    for (std::size_t i = complete + 1; i < messages.size(); ++i)
      prefetched.push_back(std::get<protocol::Face>(messages[i]).key);
    EXPECT_EQ(prefetched, expected) << "limit " << limit;
  }
}

TEST(Session, facesAlongTheMotionAreThoseOfTheNextView) {
  const TestScene scene;
  const protocol::View a = scene.view(1, {-0.4, 0.0, 0.5}, {-0.4, 0.0, 0.0});
  const protocol::View b = scene.view(2, {-0.2, 0.0, 0.5}, {-0.2, 0.0, 0.0});
  const protocol::View c = scene.view(3, {0.0, 0.0, 0.5}, {0.0, 0.0, 0.0});
  EXPECT_EQ(plan::planMotion(scene.data.toPlan(), b, a), plan::planView(scene.data.toPlan(), c).faces);
  EXPECT_TRUE(plan::planMotion(scene.data.toPlan(), b, b).empty());
}

// ---- anything a client may do, in any order ----

/// A client that keeps a cache at random and checks every message against it.
struct DrawnClient {
  DrawnClient(const TestScene& test_scene, unsigned seed) : scene(test_scene), talk(test_scene.data), random(seed) {}

  std::uint32_t whole(std::uint32_t low, std::uint32_t high) {
    return std::uniform_int_distribution<std::uint32_t>(low, high)(random);
  }
  double real() { return std::uniform_real_distribution<double>(-0.9, 0.9)(random); }

  void sendView() {
    protocol::View view =
        scene.view(++sequence, {real(), real(), 0.1 + std::abs(real())}, {0.3 * real(), 0.3 * real(), 0.0});
    view.max_points = static_cast<std::uint16_t>(whole(0, 10));
    view.max_triangles = whole(0, 5000);
    view.want_frame = whole(0, 1) == 1;
    ASSERT_TRUE(talk.say(view));
  }
  void evict() {
    protocol::Eviction evicted;
    for (const auto& key : faces)
      if (whole(0, 2) == 0) evicted.faces.push_back(key);
    for (std::uint32_t group : groups)
      if (whole(0, 2) == 0) evicted.groups.push_back(group);
    for (const auto& key : evicted.faces) faces.erase(key);
    for (std::uint32_t group : evicted.groups) groups.erase(group);
    ASSERT_TRUE(talk.say(evicted));
  }
  void readSome() {
    for (std::uint32_t i = whole(0, 40); i > 0; --i) {
      auto message = talk.next();
      if (!message) break;
      if (const auto* face = std::get_if<protocol::Face>(&*message)) {
        EXPECT_TRUE(faces.insert(face->key).second);
      }
      if (const auto* refine = std::get_if<protocol::Refinement>(&*message)) {
        EXPECT_TRUE(groups.insert(groupOf(scene.data, *refine)).second);
      }
      if (const auto* complete = std::get_if<protocol::Completion>(&*message)) {
        EXPECT_EQ(complete->sequence, sequence);
      }
    }
    if (const auto request = talk.session.nextFrameRequest()) {
      EXPECT_EQ(request->sequence, sequence);
      talk.session.frameRendered(*request, {whole(0, 3) == 0 ? base::Bytes() : someFaceValue(100, 1)});
    }
  }

  const TestScene& scene;
  Talk talk;
  std::mt19937 random;
  std::uint32_t sequence = 0;
  std::set<repository::FaceKey> faces;
  std::set<std::uint32_t> groups;
};

TEST(Session, randomClientNeverReceivesWhatItHolds) {
  const TestScene scene(8, 500);
  for (unsigned seed = 0; seed < 10; ++seed) {
    DrawnClient client(scene, seed);
    client.talk.greet();
    for (int step = 0; step < 60; ++step) {
      const std::uint32_t what = client.whole(0, 5);
      if (what <= 1) client.sendView();
      if (what == 2) client.evict();
      client.readSome();
    }
    EXPECT_FALSE(client.faces.empty() && client.groups.empty());
    EXPECT_FALSE(client.talk.session.finished());
  }
}

// ---- images that are far away ----

struct RemoteImageScene : TestScene {
  RemoteImageScene() { data.images_are_remote = true; }
  void answer(Session& session, const FaceRequest& request) const {
    session.facesFetched(request, store.getMany(request));
  }
};

bool isComplete(const std::vector<ServerMessage>& messages) {
  return std::any_of(messages.begin(), messages.end(),
                     [](const auto& message) { return std::holds_alternative<protocol::Completion>(message); });
}

TEST(RemoteImages, allFacesOfAViewAreRequestedAtOnceWhileGroupsAreSent) {
  const RemoteImageScene scene;
  const protocol::View view = scene.view(1, kAbove);
  const plan::ViewPlan plan = plan::planView(scene.data.toPlan(), view);
  ASSERT_GT(plan.faces.size(), 4U);
  Talk talk(scene.data);
  talk.greet();
  EXPECT_FALSE(talk.session.nextFaceRequest()) << "nobody looks yet";
  ASSERT_TRUE(talk.say(view));
  const auto before = talk.drain();
  EXPECT_GE(groupsIn(scene.data, before).size(), plan.groups.size());
  EXPECT_TRUE(facesIn(before).empty());
  EXPECT_FALSE(isComplete(before));

  const auto request = talk.session.nextFaceRequest();
  ASSERT_TRUE(request);
  EXPECT_EQ(*request, plan.faces);
  EXPECT_FALSE(talk.session.nextFaceRequest()) << "all are asked for";
  scene.answer(talk.session, *request);
  const auto after = talk.drain();
  EXPECT_EQ(facesIn(after), plan.faces);
  EXPECT_TRUE(isComplete(after));
}

TEST(RemoteImages, viewCompletesWithoutFacesThatCannotBeFetched) {
  const RemoteImageScene scene;
  Talk talk(scene.data);
  talk.greet();
  ASSERT_TRUE(talk.say(scene.view(1, kAbove)));
  talk.drain();
  const auto request = talk.session.nextFaceRequest();
  ASSERT_TRUE(request && request->size() > 3);
  auto values = scene.store.getMany(*request);
  values[0] = base::Error{base::ErrorCode::kNetwork, "gone"};
  values[1] = std::optional<base::Bytes>();
  values[2] = std::optional<base::Bytes>(base::Bytes{1, 2, 3});
  talk.session.facesFetched(*request, std::move(values));
  const auto after = talk.drain();
  EXPECT_EQ(facesIn(after).size(), request->size() - 3);
  EXPECT_TRUE(isComplete(after));
  EXPECT_EQ(talk.session.counts().missing, 1U);
  EXPECT_EQ(talk.session.counts().corrupt, 2U);
}

TEST(RemoteImages, prefetchRequestsAFewFacesAtATime) {
  RemoteImageScene scene;
  scene.data.ahead_bytes = 300'000;  // 15 faces
  Talk talk(scene.data);
  talk.greet();
  ASSERT_TRUE(talk.say(scene.view(1, kAbove)));
  talk.drain();
  const auto request = talk.session.nextFaceRequest();
  ASSERT_TRUE(request);
  EXPECT_FALSE(talk.session.nextFaceRequest()) << "not while the view waits";
  scene.answer(talk.session, *request);
  ASSERT_TRUE(isComplete(talk.drain()));
  for (const Load load : {Load::kShared, Load::kBehind}) {
    talk.session.setLoad(load);
    EXPECT_FALSE(talk.session.nextFaceRequest()) << "not while others work";
  }
  talk.session.setLoad(Load::kFree);
  std::size_t ahead = 0;
  while (const auto more = talk.session.nextFaceRequest()) {
    EXPECT_LE(more->size(), 16U);
    EXPECT_FALSE(talk.session.nextFaceRequest()) << "one at a time";
    scene.answer(talk.session, *more);
    ahead += facesIn(talk.drain()).size();
  }
  EXPECT_EQ(ahead, 15U);
}

// The viewer turns while faces are being fetched. Faces of both views are not fetched twice, and those of the old view
// alone are not sent.
TEST(RemoteImages, newViewRequestsOnlyFacesThatAreNotUnderWay) {
  const RemoteImageScene scene;
  const protocol::View there = scene.view(1, kAbove);
  const protocol::View here = scene.view(2, kAbove, {0.3, 0.2, 0.0});
  Talk talk(scene.data);
  talk.greet();
  ASSERT_TRUE(talk.say(there));
  talk.drain();
  const auto first = talk.session.nextFaceRequest();
  ASSERT_TRUE(first);
  ASSERT_TRUE(talk.say(here));
  talk.drain();
  const auto second = talk.session.nextFaceRequest();
  std::set<std::uint64_t> asked;
  for (const auto& key : *first) EXPECT_TRUE(asked.insert(key.code()).second);
  for (const auto& key : second.value_or(FaceRequest())) EXPECT_TRUE(asked.insert(key.code()).second) << "twice";
  scene.answer(talk.session, *first);
  if (second) scene.answer(talk.session, *second);
  const auto after = talk.drain();
  EXPECT_TRUE(isComplete(after));
  const auto plan = plan::planView(scene.data.toPlan(), here);
  const auto sent = facesIn(after);
  EXPECT_TRUE(std::is_permutation(sent.begin(), sent.end(), plan.faces.begin(), plan.faces.end()));
}

}  // namespace
}  // namespace server
