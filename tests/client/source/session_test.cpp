#include "client/source/session.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

#include "tests/client/source/scripted_server.h"

namespace client {
namespace {

const ScriptedServer& server() {
  static const ScriptedServer made;
  return made;
}

/// Returns a session that has received its Welcome.
Session ready(const SessionOptions& options = {}) {
  Session session(options);
  session.connected();
  sent(session);
  EXPECT_TRUE(bool(session.receive(server().sayWelcome())));
  return session;
}

void receive(Session& session, const base::Bytes& message) {
  auto taken = session.receive(message);
  EXPECT_TRUE(bool(taken)) << taken.error().message;
}

void refuses(Session& session, const base::Bytes& message) {
  EXPECT_FALSE(bool(session.receive(message)));
  EXPECT_FALSE(session.problem().empty());
}

SessionOptions cacheOf(std::uint64_t bytes) {
  SessionOptions options;
  options.cache_bytes = bytes;
  return options;
}

/// Checks that every cached group's parents are cached, up to group 0, so that a cut can be drawn.
bool drawable(const Session& session) {
  for (std::uint32_t g = 0; g < server().hierarchy().groups.size(); ++g) {
    if (!session.hasGroup(g)) continue;
    for (std::uint32_t parent : server().hierarchy().parentsOf(g))
      if (!session.hasGroup(parent)) return false;
  }
  return true;
}

TEST(Session, helloComesFirstAndAloneUntilTheServerWelcomes) {
  Session session({});
  session.setView(server().lookDown(20.0));
  EXPECT_TRUE(sent(session).empty()) << "nothing is said to nobody";

  session.connected();
  EXPECT_EQ(session.phase(), SessionPhase::kGreeting);
  const auto greeting = sent(session);
  ASSERT_EQ(greeting.size(), 1U);
  EXPECT_EQ(std::get<protocol::Hello>(greeting[0]).version, protocol::kVersion);
  EXPECT_EQ(session.welcome(), nullptr);

  receive(session, server().sayWelcome());
  EXPECT_EQ(session.phase(), SessionPhase::kReady);
  EXPECT_TRUE(session.takeEvents().welcomed);
  EXPECT_EQ(session.welcome()->scene_name, "synthetic");
  const auto views = only<protocol::View>(sent(session));
  ASSERT_EQ(views.size(), 1U) << "the view that was set before is sent now";
  EXPECT_EQ(views[0].sequence, 1U);
}

TEST(Session, aRefusalIsKeptWithItsReasonAfterTheConnectionCloses) {
  Session session({});
  session.connected();
  receive(session, server().sayRefusal(protocol::kVersion, "full up"));
  session.disconnected("end of file");
  EXPECT_EQ(session.phase(), SessionPhase::kRefused);
  EXPECT_NE(session.problem().find("full up"), std::string::npos) << session.problem();

  session.connected();
  EXPECT_EQ(session.phase(), SessionPhase::kGreeting) << "the next attempt starts afresh";
  EXPECT_TRUE(session.problem().empty());
}

TEST(Session, aRefusalTellsWhichOtherMethodTheSceneHasDataFor) {
  Session session({});
  session.connected();
  receive(session, server().sayRefusal(protocol::kVersion, "full up"));
  EXPECT_EQ(session.methodInstead(), std::nullopt);
  for (const auto& [streamed, method] : {std::pair(protocol::Streamed::kSplats, Method::kQsplat),
                                         {protocol::Streamed::kUmbrellas, Method::kPmr},
                                         {protocol::Streamed::kHlod, Method::kHlod}}) {
    Session other({});
    other.connected();
    const protocol::Refusal refusal{protocol::kVersion, "no patches", streamed};
    receive(other, protocol::encode(protocol::ServerMessage(refusal)));
    EXPECT_EQ(other.methodInstead(), method);
  }
  Session read({});
  read.refuse("no splats", Method::kLumigraph);
  EXPECT_EQ(read.methodInstead(), Method::kLumigraph);
  EXPECT_EQ(read.problem(), "no splats");
}

TEST(Session, anotherVersionIsNamedWithBothNumbers) {
  Session session({});
  session.connected();
  receive(session, server().sayRefusal(7, "too old"));
  EXPECT_NE(session.problem().find("protocol 7, this client " + std::to_string(protocol::kVersion)), std::string::npos)
      << session.problem();

  Session other({});
  other.connected();
  protocol::Welcome welcome = server().welcome;
  welcome.version = 9;
  refuses(other, protocol::encode(protocol::ServerMessage(welcome)));
}

TEST(Session, aViewIsSentOnceAndTheNewestWins) {
  Session session = ready();
  session.setView(server().lookDown(20.0));
  session.setView(server().lookDown(21.0));
  session.setView(server().lookDown(22.0));
  auto views = only<protocol::View>(sent(session));
  ASSERT_EQ(views.size(), 1U);
  EXPECT_EQ(views[0].camera.position, server().lookDown(22.0).position);

  session.setView(server().lookDown(22.0));
  EXPECT_TRUE(sent(session).empty()) << "the same view again";

  session.setView(server().lookDown(23.0));
  const auto later = only<protocol::View>(sent(session));
  ASSERT_EQ(later.size(), 1U);
  EXPECT_GT(later[0].sequence, views[0].sequence);
}

TEST(Session, theViewCarriesWhatTheOptionsSay) {
  SessionOptions options;
  options.images = false;
  options.frames = false;
  options.setPatchTolerance(2.5F);
  options.max_triangles = 1234;
  Session session = ready(options);
  session.setView(server().lookDown(20.0));
  const auto views = only<protocol::View>(sent(session));
  ASSERT_EQ(views.size(), 1U);
  EXPECT_EQ(views[0].max_points, 0);
  EXPECT_FALSE(views[0].want_frame);
  EXPECT_EQ(views[0].patch_tolerance_px, 2.5F);
  EXPECT_EQ(views[0].max_triangles, 1234U);
}

TEST(Session, aViewIsCompleteWhenTheServerSaysSoOfTheNewest) {
  Session session = ready();
  session.setView(server().lookDown(20.0));
  EXPECT_FALSE(session.complete());
  sent(session);
  EXPECT_FALSE(session.complete());
  receive(session, server().sayComplete(1));
  EXPECT_TRUE(session.complete());

  session.setView(server().lookDown(21.0));
  EXPECT_FALSE(session.complete()) << "the new view is not even sent";
  sent(session);
  receive(session, server().sayComplete(1));
  EXPECT_FALSE(session.complete()) << "that was the old one";
  receive(session, server().sayComplete(2));
  EXPECT_TRUE(session.complete());
}

TEST(Session, aCompleteViewMayHaveItsPatchesRefinedUntilTheNext) {
  SessionOptions options;
  options.patch_tolerance_px = 2.0F;
  options.alone_tolerance_px = 0.5F;
  options.max_triangles = 1000;
  options.max_triangles_refined = 4000;
  Session session = ready(options);
  session.setView(server().lookDown(20.0));
  session.refine();
  auto views = only<protocol::View>(sent(session));
  ASSERT_EQ(views.size(), 1U);
  EXPECT_EQ(views[0].max_triangles, 1000U) << "it was not complete";
  EXPECT_EQ(views[0].patch_tolerance_px, 2.0F);
  EXPECT_FALSE(session.mayRefine());
  receive(session, server().sayComplete(1));
  ASSERT_TRUE(session.mayRefine());

  session.refine();
  EXPECT_FALSE(session.complete());
  views = only<protocol::View>(sent(session));
  ASSERT_EQ(views.size(), 1U);
  EXPECT_EQ(views[0].sequence, 2U);
  EXPECT_EQ(views[0].measure, base::ErrorMeasure::kVisible);
  EXPECT_EQ(views[0].patch_tolerance_px, 0.5F);
  EXPECT_EQ(views[0].max_triangles, 4000U);
  receive(session, server().sayComplete(2));
  EXPECT_TRUE(session.complete());
  EXPECT_TRUE(session.refined());
  EXPECT_FALSE(session.mayRefine()) << "once";
  session.setView(server().lookDown(20.0));
  EXPECT_TRUE(session.refined()) << "it is the same view";

  session.setView(server().lookDown(21.0));
  EXPECT_FALSE(session.refined());
  views = only<protocol::View>(sent(session));
  ASSERT_EQ(views.size(), 1U);
  EXPECT_EQ(views[0].patch_tolerance_px, 2.0F);
  EXPECT_EQ(views[0].max_triangles, 1000U);
}

TEST(Session, aMovingEyeAsksForThePatchesColoursTooUnlessDataAreSpared) {
  for (const bool refine : {true, false}) {
    SessionOptions options;
    options.refine = refine;
    Session session = ready(options);
    session.setView(server().lookDown(20.0));
    auto views = only<protocol::View>(sent(session));
    ASSERT_EQ(views.size(), 1U);
    EXPECT_EQ(views[0].measure, base::ErrorMeasure::kShape);
    session.setView(server().lookDown(20.1));
    views = only<protocol::View>(sent(session));
    ASSERT_EQ(views.size(), 1U);
    EXPECT_EQ(views[0].measure, refine ? base::ErrorMeasure::kVisible : base::ErrorMeasure::kShape);
    EXPECT_EQ(session.usualPatches().measure, base::ErrorMeasure::kShape) << "what a slow machine draws";
    session.setView(server().lookDown(200.0));
    views = only<protocol::View>(sent(session));
    ASSERT_EQ(views.size(), 1U);
    EXPECT_EQ(views[0].measure, base::ErrorMeasure::kShape) << "after a jump images come first";
  }
}

void connectWithFrames(ScriptedServer& server, Session& session) {
  server.welcome.can_render_frames = true;
  session.connected();
  receive(session, server.sayWelcome());
}

TEST(Session, withExactFramesAViewIsCompleteOnceItsLastFrameIsThere) {
  ScriptedServer frames;
  Session session({});
  connectWithFrames(frames, session);
  session.setView(frames.lookDown(20.0));
  EXPECT_TRUE(only<protocol::View>(sent(session)).at(0).want_frame);
  receive(session, frames.sayComplete(1));
  EXPECT_FALSE(session.complete());
  receive(session, frames.sayFrame(1, 70, false));
  EXPECT_FALSE(session.complete()) << "that was the quick one";
  ASSERT_NE(session.frame(1), nullptr);
  EXPECT_EQ(session.frame(1)->value.size(), 70U);
  session.takeEvents();
  receive(session, frames.sayFrame(1, 100));
  EXPECT_TRUE(session.complete());
  ASSERT_NE(session.frame(2), nullptr);
  EXPECT_EQ(session.frame(2)->value.size(), 100U);
  EXPECT_NE(session.frame(1), nullptr) << "it is shown until the better one is decoded";
  EXPECT_EQ(session.takeEvents().frames_added, std::vector<std::uint32_t>{2});
}

TEST(Session, nothingIsRefinedWhereAFrameShowsAllOrNobodyAsksForIt) {
  ScriptedServer frames;
  Session session({});
  connectWithFrames(frames, session);
  session.setView(frames.lookDown(20.0));
  sent(session);
  receive(session, frames.sayComplete(1));
  receive(session, frames.sayFrame(1, 100));
  ASSERT_TRUE(session.complete());
  EXPECT_FALSE(session.mayRefine());
  for (const bool images : {false, true}) {
    SessionOptions options;
    options.images = images;
    options.refine = !images;
    Session other = ready(options);
    other.setView(server().lookDown(20.0));
    sent(other);
    receive(other, server().sayComplete(1));
    ASSERT_TRUE(other.complete());
    EXPECT_FALSE(other.mayRefine()) << images;
    other.refine();
    EXPECT_TRUE(sent(other).empty());
  }
}

TEST(Session, onlyTheFourNewestFramesAreKept) {
  ScriptedServer frames;
  Session session({});
  connectWithFrames(frames, session);
  for (std::uint32_t i = 1; i <= 6; ++i) {
    session.setView(frames.lookDown(20.0 + i));
    sent(session);
    receive(session, frames.sayFrame(i, 100));
  }
  EXPECT_EQ(session.frame(2), nullptr);
  for (std::uint32_t i = 3; i <= 6; ++i) EXPECT_NE(session.frame(i), nullptr) << i;
}

TEST(Session, framesOnTheirWayWhenTheyAreSwitchedOffAreDropped) {
  ScriptedServer frames;
  Session session({});
  connectWithFrames(frames, session);
  session.setView(frames.lookDown(20.0));
  sent(session);
  session.setWanted(true, false);
  receive(session, frames.sayFrame(1, 100));
  EXPECT_EQ(session.frame(1), nullptr);
  EXPECT_EQ(session.phase(), SessionPhase::kReady);
}

TEST(Session, framesAreKeptAsFarAsTheirBytesAllow) {
  ScriptedServer frames;
  frames.welcome.can_render_frames = true;
  SessionOptions options;
  options.frame_bytes = 250;
  Session session(options);
  session.connected();
  receive(session, frames.sayWelcome());
  for (std::uint32_t i = 1; i <= 3; ++i) {
    session.setView(frames.lookDown(20.0 + i));
    sent(session);
    receive(session, frames.sayFrame(i, 100));
  }
  EXPECT_EQ(session.frame(1), nullptr);
  EXPECT_NE(session.frame(2), nullptr);
  EXPECT_EQ(session.stats().frame_bytes, 200U);

  // A frame that is too large by itself has arrived nevertheless, so nothing more is awaited.
  session.setView(frames.lookDown(30.0));
  sent(session);
  receive(session, frames.sayFrame(4, 300));
  receive(session, frames.sayComplete(4));
  EXPECT_EQ(session.frame(4), nullptr);
  EXPECT_EQ(session.stats().frame_bytes, 0U);
  EXPECT_TRUE(session.complete());
}

// Other messages come between the parts of a large one, which counts by what it is.
TEST(Session, aMessageInPartsIsTakenWithItsLast) {
  const auto& s = server();
  Session session = ready();
  const base::Bytes face = s.sayFace({1, 1, 1, 3}, 5'000);
  protocol::PartSender parts(protocol::Stream::kData);
  parts.begin(face);
  receive(session, parts.next(2'000));
  receive(session, s.sayGroup(0));
  receive(session, parts.next(2'000));
  EXPECT_EQ(session.stats().groups_received, 1U);
  EXPECT_EQ(session.stats().faces_received, 0U);
  receive(session, parts.next(2'000));
  EXPECT_EQ(session.stats().faces_received, 1U);
  EXPECT_EQ(session.stats().bytes_faces, face.size());
}

TEST(Session, aConnectionThatBreaksLeavesNoPartsBehind) {
  const auto& s = server();
  Session session = ready();
  protocol::PartSender parts(protocol::Stream::kData);
  parts.begin(s.sayFace({1, 1, 1, 3}, 5'000));
  receive(session, parts.next(2'000));
  session.disconnected("broken");
  session.connected();
  receive(session, s.sayWelcome());
  refuses(session, parts.next(2'000));
}

TEST(Session, bytesAreCountedByKind) {
  ScriptedServer frames;
  frames.welcome.can_render_frames = true;
  Session session({});
  session.connected();
  sent(session);
  std::uint64_t total = 0;
  const auto say = [&](const base::Bytes& message) {
    total += message.size();
    receive(session, message);
    return message.size();
  };
  say(frames.sayWelcome());
  session.setView(frames.lookDown(20.0));
  sent(session);
  const std::uint64_t group = say(frames.sayGroup(0));
  const std::uint64_t face = say(frames.sayFace({1, 1, 1, 3}, 1000)) + say(frames.sayFace({1, 1, 1, 4}, 500));
  const std::uint64_t frame = say(frames.sayFrame(1, 700));
  say(frames.sayComplete(1));

  const SessionStats& stats = session.stats();
  EXPECT_EQ(stats.bytes_received, total);
  EXPECT_EQ(stats.bytes_patches, group);
  EXPECT_EQ(stats.bytes_faces, face);
  EXPECT_EQ(stats.bytes_frames, frame);
  EXPECT_EQ(stats.messages_received, 6U);
  EXPECT_EQ(stats.faces_received, 2U);
  EXPECT_EQ(stats.groups_received, 1U);
  EXPECT_GE(stats.cache_bytes, 1500U);
}

TEST(Session, theLeastRecentlyUsedFaceGoesFirstAndTheServerIsToldWithTheNextView) {
  Session session = ready(cacheOf(3500));
  session.setView(server().lookDown(20.0));
  sent(session);
  receive(session, server().sayFace({0, 0, 0, 0}, 1000));
  receive(session, server().sayFace({0, 0, 0, 1}, 1000));
  receive(session, server().sayFace({0, 0, 0, 2}, 1000));
  ASSERT_NE(session.face({0, 0, 0, 0}), nullptr) << "and is used";
  session.takeEvents();
  receive(session, server().sayFace({0, 0, 0, 3}, 1000));

  const repository::FaceKey gone{0, 0, 0, 1};
  EXPECT_EQ(session.face(gone), nullptr);
  EXPECT_NE(session.face({0, 0, 0, 0}), nullptr);
  EXPECT_LE(session.stats().cache_bytes, 3500U);
  EXPECT_EQ(session.takeEvents().faces_evicted, std::vector<repository::FaceKey>{gone});
  EXPECT_TRUE(sent(session).empty()) << "told at once, the server would send it again for the same view";

  session.setView(server().lookDown(21.0));
  const auto messages = sent(session);
  ASSERT_EQ(messages.size(), 2U);
  EXPECT_EQ(std::get<protocol::Eviction>(messages[0]).faces, std::vector<repository::FaceKey>{gone});
  EXPECT_TRUE(std::holds_alternative<protocol::View>(messages[1]));
}

TEST(Session, anItemThatCameAgainIsNotReportedAsEvicted) {
  Session session = ready(cacheOf(2500));
  session.setView(server().lookDown(20.0));
  sent(session);
  for (std::uint32_t d : {0U, 1U, 2U, 0U}) receive(session, server().sayFace({0, 0, 0, d}, 1000));
  session.setView(server().lookDown(21.0));
  const auto evicted = only<protocol::Eviction>(sent(session));
  ASSERT_EQ(evicted.size(), 1U);
  EXPECT_EQ(evicted[0].faces, (std::vector<repository::FaceKey>{{0, 0, 0, 1}}));
}

TEST(Session, evictsTheNewFaceRatherThanOnesInUse) {
  Session session = ready(cacheOf(2500));
  receive(session, server().sayFace({0, 0, 0, 0}, 1000));
  receive(session, server().sayFace({0, 0, 0, 1}, 1000));
  session.setInUse({{0, 0, 0, 0}, {0, 0, 0, 1}}, {});
  receive(session, server().sayFace({0, 0, 0, 2}, 1000));
  EXPECT_NE(session.face({0, 0, 0, 0}), nullptr);
  EXPECT_NE(session.face({0, 0, 0, 1}), nullptr);
  EXPECT_EQ(session.face({0, 0, 0, 2}), nullptr);

  session.setInUse({}, {});
  receive(session, server().sayFace({0, 0, 0, 2}, 1000));
  EXPECT_NE(session.face({0, 0, 0, 2}), nullptr);
}

TEST(Session, evictionKeepsEveryCutDrawable) {
  // A cache of 12 kB gets the whole hierarchy and many faces, in an order that a server could choose, while some groups
  // are used.
  Session session = ready(cacheOf(12'000));
  std::mt19937 random(4);
  const auto count = static_cast<std::uint32_t>(server().hierarchy().groups.size());
  std::set<std::uint32_t> told;
  for (int round = 0; round < 20; ++round) {
    for (std::uint32_t g = 0; g < count; ++g) {
      if (session.hasGroup(g) || random() % 3 == 0) continue;
      const auto parents = server().hierarchy().parentsOf(g);
      if (!std::all_of(parents.begin(), parents.end(), [&](std::uint32_t p) { return session.hasGroup(p); })) continue;
      receive(session, server().sayGroup(g));
      EXPECT_TRUE(drawable(session)) << "after group " << g << " in round " << round;
      if (random() % 2 == 0) session.block(static_cast<std::uint32_t>(random() % count));
    }
    for (std::uint32_t d = 0; d < 6; ++d)
      receive(session, server().sayFace({static_cast<std::uint32_t>(random() % 4), 1, 1, d}, 400));
    EXPECT_TRUE(session.hasGroup(0));
    EXPECT_TRUE(drawable(session));
    EXPECT_LE(session.stats().cache_bytes, 12'000U);
    for (std::uint32_t g : session.takeEvents().groups_evicted) told.insert(g);
  }
  EXPECT_GT(told.size(), 3U) << "groups have to go at all for this test to say something";
}

TEST(Session, aCutInUseOutlivesAFloodOfFaces) {
  Session session = ready(cacheOf(20'000));
  std::vector<std::uint32_t> cut;
  for (std::uint32_t g = 0; g < 4; ++g) {
    receive(session, server().sayGroup(g));
    cut.push_back(g);
  }
  session.setInUse({}, cut);
  for (std::uint32_t x = 0; x < 4; ++x)
    for (std::uint32_t y = 0; y < 4; ++y)
      for (std::uint32_t d = 0; d < 6; ++d) receive(session, server().sayFace({x, y, 0, d}, 1000));
  for (std::uint32_t g : cut) EXPECT_TRUE(session.hasGroup(g)) << g;
}

TEST(Session, aReconnectTellsWhatIsHereAndSendsTheViewAgain) {
  Session session = ready();
  session.setView(server().lookDown(20.0));
  sent(session);
  receive(session, server().sayGroup(0));
  receive(session, server().sayGroup(1));
  receive(session, server().sayFace({1, 2, 1, 5}, 100));
  receive(session, server().sayComplete(1));
  session.takeEvents();

  session.disconnected("the cable was pulled");
  EXPECT_EQ(session.phase(), SessionPhase::kDisconnected);
  EXPECT_EQ(session.problem(), "the cable was pulled");
  EXPECT_FALSE(session.complete());
  EXPECT_TRUE(session.hasGroup(1)) << "what is here can be looked at meanwhile";
  EXPECT_NE(session.welcome(), nullptr);
  EXPECT_TRUE(sent(session).empty());

  session.connected();
  EXPECT_EQ(only<protocol::Hello>(sent(session)).size(), 1U);
  receive(session, server().sayWelcome());
  EXPECT_FALSE(session.takeEvents().welcomed) << "nothing changed for the viewer";
  const auto messages = sent(session);
  ASSERT_EQ(messages.size(), 2U);
  protocol::Holdings have = std::get<protocol::Holdings>(messages[0]);
  std::sort(have.groups.begin(), have.groups.end());
  EXPECT_EQ(have.groups, (std::vector<std::uint32_t>{0, 1}));
  EXPECT_EQ(have.faces, (std::vector<repository::FaceKey>{{1, 2, 1, 5}}));
  EXPECT_GT(std::get<protocol::View>(messages[1]).sequence, 1U);
  EXPECT_FALSE(session.complete()) << "Completion 1 was another connection's";
}

TEST(Session, aLongListOfWhatIsHereIsSentInParts) {
  ScriptedServer large;
  large.welcome.grid.count = {30, 30, 30};
  Session session({});
  session.connected();
  receive(session, large.sayWelcome());
  std::set<std::uint64_t> all;
  for (std::uint32_t i = 0; i < 10'000; ++i) {
    const repository::FaceKey key{i % 30, i / 30 % 30, i / 900, i % 6};
    all.insert(key.code());
    receive(session, large.sayFace(key, 10));
  }
  session.disconnected("");
  session.connected();
  receive(session, large.sayWelcome());
  std::set<std::uint64_t> told;
  const auto parts = only<protocol::Holdings>(sent(session));
  EXPECT_EQ(parts.size(), (all.size() + protocol::kMaxKeysPerMessage - 1) / protocol::kMaxKeysPerMessage);
  for (const protocol::Holdings& have : parts)
    for (const repository::FaceKey& key : have.faces) told.insert(key.code());
  EXPECT_EQ(told, all);
}

// A server may remember the first of them only.
TEST(Session, whatWasUsedLastIsNamedFirst) {
  Session session = ready();
  std::vector<repository::FaceKey> newest_first;
  for (std::uint32_t x = 0; x < 3; ++x) {
    const repository::FaceKey key{x, 2, 1, 5};
    receive(session, server().sayFace(key, 100));
    newest_first.insert(newest_first.begin(), key);
  }
  ASSERT_NE(session.face(newest_first.back()), nullptr);  // which uses it
  std::rotate(newest_first.begin(), newest_first.end() - 1, newest_first.end());
  session.disconnected("");
  session.connected();
  receive(session, server().sayWelcome());
  const auto parts = only<protocol::Holdings>(sent(session));
  ASSERT_EQ(parts.size(), 1U);
  EXPECT_EQ(parts.front().faces, newest_first);
}

TEST(Session, anotherSceneAfterAReconnectDropsEverything) {
  Session session = ready();
  receive(session, server().sayGroup(0));
  receive(session, server().sayFace({1, 2, 1, 5}, 100));
  session.disconnected("gone");
  session.connected();
  sent(session);

  ScriptedServer other;
  other.welcome.scene_name = "another";
  receive(session, other.sayWelcome());
  const SessionEvents events = session.takeEvents();
  EXPECT_TRUE(events.welcomed);
  EXPECT_TRUE(events.faces_added.empty());
  EXPECT_FALSE(session.hasGroup(0));
  EXPECT_EQ(session.face({1, 2, 1, 5}), nullptr);
  EXPECT_EQ(session.stats().cache_bytes, 0U);
  EXPECT_TRUE(session.hierarchy().groups.empty());
  EXPECT_TRUE(only<protocol::Holdings>(sent(session)).empty());
}

TEST(Session, aServerThatBreaksTheRulesIsRefused) {
  const auto& s = server();
  struct Row {
    const char* what;
    base::Bytes message;
  };
  protocol::Refinement short_block = s.refine(0);
  short_block.block.pop_back();
  protocol::Refinement long_record = s.refine(0);
  long_record.record.push_back(0);
  ScriptedServer bigger;
  bigger.welcome.group_count = 3;
  const Row rows[] = {
      {"Welcome twice", s.sayWelcome()},
      {"a face outside the grid", s.sayFace({4, 0, 0, 0}, 10)},
      {"a block shorter than its record says", protocol::encode(protocol::ServerMessage(short_block))},
      {"a record with more behind it", protocol::encode(protocol::ServerMessage(long_record))},
      {"Completion for a view never sent", s.sayComplete(5)},
      {"a frame for a view never sent", s.sayFrame(5, 10)},
      {"a part without a first one", protocol::encode(protocol::ServerMessage(protocol::Part{.bytes = {1}}))},
      {"a part of nonsense",
       protocol::encode(protocol::ServerMessage(protocol::Part{.first = true, .last = true, .bytes = {0x42}}))},
      {"a part of a part",
       protocol::encode(protocol::ServerMessage(protocol::Part{
           .first = true,
           .last = true,
           .bytes = protocol::encode(protocol::ServerMessage(protocol::Part{.first = true, .bytes = {1}}))}))},
      {"nothing", {}},
      {"an unknown type", {0x42, 1, 2, 3}},
  };
  for (const Row& row : rows) {
    SCOPED_TRACE(row.what);
    Session session = ready();
    refuses(session, row.message);
  }

  Session early({});
  early.connected();
  refuses(early, s.sayGroup(0));

  SessionOptions patches_only;
  patches_only.images = false;
  Session session = ready(patches_only);
  refuses(session, s.sayFace({0, 0, 0, 0}, 10));
}

TEST(Session, groupsBeyondTheAnnouncedCountsAreRefused) {
  ScriptedServer small;
  small.welcome.group_count = 3;
  Session session({});
  session.connected();
  receive(session, small.sayWelcome());
  refuses(session, small.sayGroup(static_cast<std::uint32_t>(small.hierarchy().groups.size()) - 1));
}

TEST(Session, everyTruncationAndManyFlipsOfGoodMessagesDoNoHarm) {
  const std::vector<base::Bytes> good{server().sayWelcome(), server().sayGroup(2), server().sayFace({0, 0, 0, 0}, 30),
                                      server().sayFrame(1, 30), server().sayRefusal(1, "no")};
  std::mt19937 random(11);
  for (const base::Bytes& message : good) {
    for (std::size_t length = 0; length < message.size(); length += 1 + length / 64) {
      Session session = ready();
      (void)session.receive(base::ByteView(message).first(length));
    }
    for (int i = 0; i < 300; ++i) {
      base::Bytes flipped = message;
      flipped[random() % flipped.size()] ^= static_cast<std::uint8_t>(1U << (random() % 8));
      Session session = ready();
      (void)session.receive(flipped);
      EXPECT_TRUE(drawable(session) || !session.hasGroup(0));
    }
  }
}

TEST(Session, aFloodOfFacesNeitherGrowsTheCacheNorTheListOfWhatWent) {
  ScriptedServer large;
  large.welcome.grid.count = {40, 40, 40};
  Session session(cacheOf(10'000));
  session.connected();
  receive(session, large.sayWelcome());
  sent(session);
  std::size_t told = 0;
  for (std::uint32_t i = 0; i < 30'000; ++i) {
    receive(session, large.sayFace({i % 40, i / 40 % 40, i / 1600, i % 6}, 1));
    EXPECT_LE(session.stats().cache_bytes, 10'000U);
    for (const auto& evicted : only<protocol::Eviction>(sent(session))) told += evicted.faces.size();
  }
  EXPECT_GE(told, 2 * protocol::kMaxKeysPerMessage) << "long lists go out without waiting for a view";
}

}  // namespace
}  // namespace client
