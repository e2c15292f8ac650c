#include "server/session/message_cache.h"

#include <gtest/gtest.h>

#include <functional>
#include <thread>
#include <vector>

#include "tests/server/session/memory_store.h"

namespace server {
namespace {

SharedMessage messageOf(std::size_t bytes, std::uint8_t fill) {
  return base::Bytes(bytes, fill);
}

TEST(MessageCache, keepsWhatWasAdded) {
  MessageCache cache(1 << 20);
  const repository::FaceKey face{1, 2, 3, 4};
  cache.add(MessageCache::keyOf(face), messageOf(100, 7));
  cache.add(MessageCache::keyOf(5U), messageOf(50, 8));
  ASSERT_TRUE(cache.find(MessageCache::keyOf(face)));
  EXPECT_EQ(cache.find(MessageCache::keyOf(face))->bytes(), base::Bytes(100, 7));
  EXPECT_EQ(cache.find(MessageCache::keyOf(5U))->size(), 50U);
  EXPECT_FALSE(cache.find(MessageCache::keyOf(6U)));
  EXPECT_EQ(cache.bytes(), 150U);
  EXPECT_EQ(cache.counts().hits, 3U);
  EXPECT_EQ(cache.counts().misses, 1U);
}

// However much is added, the limit holds, and a message that is asked for again and again stays.
TEST(MessageCache, theLeastRecentlyUsedGo) {
  constexpr std::uint64_t kLimit = 1 << 20;
  MessageCache cache(kLimit);
  cache.add(MessageCache::keyOf(0U), messageOf(1000, 1));
  for (std::uint32_t group = 1; group < 5000; ++group) {
    cache.add(MessageCache::keyOf(group), messageOf(1000, 2));
    ASSERT_TRUE(cache.find(MessageCache::keyOf(0U))) << group;
    ASSERT_LE(cache.bytes(), kLimit);
  }
  EXPECT_GT(cache.bytes(), kLimit / 2);
  EXPECT_FALSE(cache.find(MessageCache::keyOf(1U)));
}

TEST(MessageCache, aMessageLargerThanAShardIsNotKept) {
  MessageCache cache(16'000);
  cache.add(1, messageOf(1001, 1));
  EXPECT_FALSE(cache.find(1));
  EXPECT_EQ(cache.bytes(), 0U);
}

TEST(MessageCache, severalThreads) {
  MessageCache cache(1 << 18);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      for (std::uint32_t i = 0; i < 20'000; ++i) {
        const std::uint32_t group = i * 7919U % 997U;
        if (const auto found = cache.find(MessageCache::keyOf(group)))
          ASSERT_EQ(found->bytes()[0], static_cast<std::uint8_t>(group));
        else
          cache.add(MessageCache::keyOf(group), messageOf(500, static_cast<std::uint8_t>(group)));
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
}

/// The next message of a session.
using Next = std::function<std::optional<SharedMessage>(Session&)>;

/// All messages of one view of a new client.
std::vector<SharedMessage> messagesOfAView(
    const SceneData& data, const Next& next = [](Session& session) { return session.nextMessage(); }) {
  Session session(data);
  EXPECT_TRUE(session.receive(protocol::encode(protocol::ClientMessage(protocol::Hello{}))));
  protocol::View view;
  view.sequence = 1;
  view.camera.position = {16.0, 16.0, 20.0};
  view.camera.direction = {0.0, 0.0, -1.0};
  view.camera.up = {0.0, 1.0, 0.0};
  EXPECT_TRUE(session.receive(protocol::encode(protocol::ClientMessage(view))));
  std::vector<SharedMessage> messages;
  while (auto message = next(session)) messages.push_back(std::move(*message));
  return messages;
}

protocol::Welcome welcomeOf(Session& session) {
  EXPECT_TRUE(session.receive(protocol::encode(protocol::ClientMessage(protocol::Hello{}))));
  const auto message = protocol::decodeServerMessage(*session.nextMessage());
  return std::get<protocol::Welcome>(*message);
}

TEST(SessionStart, isSharedUntilTheWelcomeChanges) {
  TestScene scene;
  Session first(scene.data);
  const auto start = scene.data.start;
  ASSERT_TRUE(start);
  EXPECT_EQ(start->coarse, plan::coarseGroups(scene.patches->hierarchy(), plan::kCoarseBytes));
  const Session second(scene.data);
  EXPECT_EQ(scene.data.start, start);

  scene.data.welcome.units = "ft";
  Session third(scene.data);
  EXPECT_NE(scene.data.start, start);
  EXPECT_EQ(scene.data.start->coarse, start->coarse);
  EXPECT_EQ(welcomeOf(third).units, "ft");
  EXPECT_EQ(welcomeOf(first).units, "") << "a session keeps the Welcome that it began with";
}

TEST(SessionStart, belongsToThePatchesOfItsScene) {
  const TestScene large(8), small(2);
  SceneData data = large.data;
  const std::size_t of_large = startOf(data)->coarse.size();
  data.patches = small.data.patches;
  const auto start = startOf(data);
  EXPECT_EQ(start->coarse, plan::coarseGroups(small.patches->hierarchy(), plan::kCoarseBytes));
  EXPECT_NE(start->coarse.size(), of_large);
  data.patches = nullptr;
  EXPECT_TRUE(startOf(data)->coarse.empty());
}

TEST(MessageCache, viewersOfTheSamePlaceAreSentTheSameBytes) {
  TestScene scene;
  const auto alone = messagesOfAView(scene.data);
  MessageCache cache(std::uint64_t{64} << 20);
  scene.data.messages = &cache;
  const auto first = messagesOfAView(scene.data);
  const auto second = messagesOfAView(scene.data);
  ASSERT_EQ(first.size(), alone.size());
  ASSERT_EQ(second.size(), alone.size());
  std::size_t shared = 0;
  for (std::size_t i = 0; i < alone.size(); ++i) {
    EXPECT_EQ(first[i].bytes(), alone[i].bytes());
    EXPECT_EQ(second[i].bytes(), alone[i].bytes());
    shared += first[i].data() == second[i].data() ? 1 : 0;
  }
  // All but Completion. The Welcome is that of the scene's SessionStart.
  EXPECT_EQ(shared, alone.size() - 1);
}

/// How often a session had a message ready, and had to take its time for one.
struct Taken {
  std::size_t ready = 0, in_time = 0;
};

std::vector<SharedMessage> messagesReadyFirst(const SceneData& data, Taken& taken) {
  return messagesOfAView(data, [&](Session& session) {
    if (auto message = session.nextReadyMessage()) return ++taken.ready, message;
    if (!session.needsTime()) return std::optional<SharedMessage>();
    auto message = session.nextMessage();
    if (message) ++taken.in_time;
    return message;
  });
}

// Whoever takes what is ready, and waits only for the rest, is sent the same messages in the same order.
TEST(ReadyMessages, areTheNextMessages) {
  TestScene scene;
  scene.data.ahead_bytes = 0;
  const auto alone = messagesOfAView(scene.data);
  Taken nothing_kept;
  const auto read = messagesReadyFirst(scene.data, nothing_kept);
  // Welcome and Completion alone need neither a plan nor the cache.
  EXPECT_EQ(nothing_kept.ready, 2U);

  MessageCache cache(std::uint64_t{64} << 20);
  scene.data.messages = &cache;
  messagesOfAView(scene.data);
  Taken all_kept;
  const auto cached = messagesReadyFirst(scene.data, all_kept);
  EXPECT_EQ(all_kept.in_time, 1U);  // the view had to be planned for

  // A cache that is too small has lost some of them.
  MessageCache small(cache.bytes() / 2);
  scene.data.messages = &small;
  messagesOfAView(scene.data);
  Taken some_kept;
  const auto mixed = messagesReadyFirst(scene.data, some_kept);
  EXPECT_GT(some_kept.in_time, 1U);
  EXPECT_GT(some_kept.ready, 2U);

  for (const auto* other : {&read, &cached, &mixed}) {
    ASSERT_EQ(other->size(), alone.size());
    for (std::size_t i = 0; i < alone.size(); ++i) EXPECT_EQ((*other)[i].bytes(), alone[i].bytes()) << i;
  }
}

// For an image that is not stored, too, somebody has to look.
TEST(ReadyMessages, leaveMissingImagesToOthers) {
  TestScene scene;
  scene.data.ahead_bytes = 0;
  MessageCache cache(std::uint64_t{64} << 20);
  scene.data.messages = &cache;
  messagesOfAView(scene.data);
  std::erase_if(scene.store.values, [](const auto& one) { return one.first.d != 5; });
  MessageCache other(std::uint64_t{64} << 20);
  scene.data.messages = &other;
  const auto alone = messagesOfAView(scene.data);
  Taken taken;
  const auto ready = messagesReadyFirst(scene.data, taken);
  ASSERT_EQ(ready.size(), alone.size());
  for (std::size_t i = 0; i < alone.size(); ++i) EXPECT_EQ(ready[i].bytes(), alone[i].bytes()) << i;
}

}  // namespace
}  // namespace server
