#include "server/session/session_runner.h"

#include <gtest/gtest.h>

#include <condition_variable>
#include <deque>
#include <future>
#include <thread>
#include <variant>

#include "tests/server/session/memory_store.h"

namespace server {
namespace {

/// A connection without a socket: takes outputs as they come, and writes when the test says so.
class FakeConnection {
  /// A worker that is ending a turn may still add to them when the connection has gone.
  struct Outputs {
    std::mutex mutex;
    std::condition_variable changed;
    std::deque<SessionOutput> waiting;
  };
  const std::shared_ptr<Outputs> outputs_ = std::make_shared<Outputs>();  // before the runner, which is given it

 public:
  FakeConnection(const SceneData& scene, FairQueue& workers, std::uint64_t client = 1)
      : runner(std::make_shared<SessionRunner>(scene, nullptr, workers, client,
                                               [outputs = outputs_](SessionOutput output) {
                                                 const std::lock_guard lock(outputs->mutex);
                                                 outputs->waiting.push_back(std::move(output));
                                                 outputs->changed.notify_all();
                                               })) {}
  ~FakeConnection() { runner->end(); }

  void send(const protocol::ClientMessage& message) { runner->receive(protocol::encode(message), state()); }
  /// Says Hello and takes the answer.
  void greet() {
    send(protocol::Hello{protocol::kVersion, "a program"});
    next();
  }
  /// Waits for the output of the next turn, which stays.
  void waitForOutput() {
    std::unique_lock lock(outputs_->mutex);
    EXPECT_TRUE(
        outputs_->changed.wait_for(lock, std::chrono::seconds(20), [this] { return !outputs_->waiting.empty(); }));
  }
  /// Waits for the output of the next turn and takes it.
  SessionOutput next() {
    waitForOutput();
    const std::lock_guard lock(outputs_->mutex);
    SessionOutput output = std::move(outputs_->waiting.front());
    outputs_->waiting.pop_front();
    runner->take(output);
    for (const SharedMessage& message : output.messages) unwritten += message.size();
    return output;
  }
  /// Waits for an output with messages, and takes it and those before it.
  std::vector<SharedMessage> nextMessages() {
    for (;;)
      if (SessionOutput output = next(); !output.messages.empty()) return std::move(output.messages);
  }
  /// Tells that all was written.
  void written() {
    unwritten = 0;
    tellRoom();
  }
  void tellRoom() { addReady(runner->tellRoom(state())); }
  void wake() { addReady(runner->wake(state())); }
  /// Takes and writes until Completion(sequence); returns the types' counts.
  std::size_t readUntilComplete(std::uint32_t sequence) {
    for (std::size_t messages = 0;;) {
      for (const SharedMessage& bytes : next().messages) {
        ++messages;
        const auto message = protocol::decodeServerMessage(bytes);
        EXPECT_TRUE(message);
        const auto* complete = std::get_if<protocol::Completion>(&*message);
        if (complete != nullptr && complete->sequence == sequence) return messages;
      }
      written();
    }
  }
  ConnectionState state() const { return {{seconds, unwritten, 0, 0.0}, unwritten}; }

  void addReady(std::optional<SessionOutput> ready) {
    if (!ready) return;
    const std::lock_guard lock(outputs_->mutex);
    outputs_->waiting.push_back(std::move(*ready));
  }

  double seconds = 0.0;
  std::uint64_t unwritten = 0;
  std::shared_ptr<SessionRunner> runner;
};

/// Keeps the only thread of the workers until it is freed.
class BusyThread {
 public:
  explicit BusyThread(FairQueue& workers) {
    workers.submit(99, [this, freed = freed_.get_future().share()] {
      begun_.set_value();
      freed.wait();
    });
    begun_.get_future().wait();
  }
  void free() { freed_.set_value(); }

 private:
  std::promise<void> begun_, freed_;
};

protocol::View someView(std::uint32_t sequence) {
  protocol::View view;
  view.sequence = sequence;
  view.camera.position = {16.0, 16.0, 20.0};
  view.camera.direction = {0.0, 0.0, -1.0};
  view.camera.up = {0.0, 1.0, 0.0};
  view.camera.width = 320;
  view.camera.height = 240;
  return view;
}

TEST(SessionRunner, servesAViewToItsCompletion) {
  const TestScene scene;
  FairQueue workers(2);
  FakeConnection connection(scene.data, workers);
  connection.send(protocol::Hello{protocol::kVersion, "a program"});
  const SessionOutput greeting = connection.next();
  EXPECT_EQ(greeting.client_name, "a program");
  ASSERT_EQ(greeting.messages.size(), 1U);
  connection.written();
  connection.send(someView(1));
  EXPECT_GT(connection.readUntilComplete(1), 5U);
  const SessionCounts counts = connection.runner->counts();
  EXPECT_EQ(counts.views, 1U);
  EXPECT_GT(counts.faces, 0U);
}

// The back-pressure: while so much waits, however many turns there are, nothing is made.
TEST(SessionRunner, makesNothingWhileTheConnectionIsFull) {
  const TestScene scene;
  FairQueue workers(2);
  FakeConnection connection(scene.data, workers);
  connection.send(protocol::Hello{protocol::kVersion, "a program"});
  EXPECT_EQ(connection.next().messages.size(), 1U);
  connection.unwritten = kBytesAhead;
  connection.send(someView(1));
  EXPECT_TRUE(connection.next().messages.empty());
  connection.tellRoom();
  EXPECT_TRUE(connection.next().messages.empty());
  connection.written();
  EXPECT_FALSE(connection.nextMessages().empty());
}

// Without this a server with many viewers would be woken for each of them all the time.
TEST(SessionRunner, isNotWokenToSeeWhetherAConnectionHasRoomThatTellsOfIt) {
  const TestScene scene;
  FairQueue workers(2);
  FakeConnection connection(scene.data, workers);
  connection.greet();
  connection.unwritten = 1000;  // less than it may hold, and nothing is known of the link yet
  connection.send(someView(1));
  const SessionOutput output = connection.next();
  EXPECT_TRUE(output.messages.empty());
  EXPECT_FALSE(output.wake_at);
  connection.written();
  EXPECT_FALSE(connection.nextMessages().empty());
}

// Each turn hands work from thread to thread and back. A session that has sent all has no use for room.
TEST(SessionRunner, takesNoTurnForRoomOnceAllIsSent) {
  TestScene scene;
  scene.data.ahead_bytes = 0;
  FairQueue workers(1);
  FakeConnection connection(scene.data, workers);
  connection.greet();
  connection.seconds = 1.0;
  connection.written();
  connection.send(someView(1));
  connection.readUntilComplete(1);
  connection.written();

  BusyThread busy(workers);
  connection.written();
  EXPECT_EQ(workers.waiting(), 0U);
  connection.wake();
  EXPECT_EQ(workers.waiting(), 0U);
  connection.next();
  connection.send(someView(2));
  EXPECT_EQ(workers.waiting(), 1U);
  busy.free();
  connection.next();
}

// To find a message in the cache takes microseconds, and to wake a worker for it several times as long.
TEST(SessionRunner, whatIsReadyTakesNoWorker) {
  TestScene scene(8, 20'000);
  scene.data.ahead_bytes = 0;
  MessageCache cache(std::uint64_t{64} << 20);
  scene.data.messages = &cache;
  FairQueue workers(1);
  FakeConnection first(scene.data, workers);
  first.greet();
  first.written();
  first.send(someView(1));
  first.readUntilComplete(1);

  FakeConnection second(scene.data, workers, 2);
  second.greet();
  second.written();
  second.send(someView(1));
  ASSERT_FALSE(second.next().messages.empty());  // planned for by a worker
  BusyThread busy(workers);
  second.written();
  EXPECT_EQ(workers.waiting(), 0U);
  second.readUntilComplete(1);
  EXPECT_EQ(second.runner->counts().bytes, first.runner->counts().bytes);
  busy.free();
}

// A turn's output may be under way between threads when the connection has room again.
TEST(SessionRunner, nothingOvertakesWhatATurnMade) {
  TestScene scene(8, 20'000);
  MessageCache cache(std::uint64_t{64} << 20);
  scene.data.messages = &cache;
  FairQueue workers(1);
  FakeConnection connection(scene.data, workers);
  connection.greet();
  connection.written();
  connection.send(someView(1));
  connection.waitForOutput();
  EXPECT_FALSE(connection.runner->tellRoom(connection.state()));
  EXPECT_FALSE(connection.runner->wake(connection.state()));
  EXPECT_FALSE(connection.next().messages.empty());
}

// Messages that wait in front of a busy worker are accepted in one turn, which plans for the newest view alone.
TEST(SessionRunner, ofViewsThatWaitTheNewestIsPlannedFor) {
  const TestScene scene;
  FairQueue workers(1);
  FakeConnection connection(scene.data, workers);
  connection.greet();
  connection.written();

  BusyThread busy(workers);
  for (std::uint32_t sequence = 1; sequence <= 5; ++sequence) connection.send(someView(sequence));
  EXPECT_FALSE(connection.runner->isFull());
  busy.free();
  connection.readUntilComplete(5);
  EXPECT_EQ(connection.runner->counts().views, 5U);
}

TEST(SessionRunner, isFullWhenMuchWaitsForATurn) {
  const TestScene scene;
  FairQueue workers(1);
  FakeConnection connection(scene.data, workers);
  BusyThread busy(workers);
  for (std::size_t i = 0; i < kMaxEvents; ++i) {
    EXPECT_FALSE(connection.runner->isFull());
    connection.send(someView(1));
  }
  EXPECT_TRUE(connection.runner->isFull());
  FakeConnection other(scene.data, workers, 2);
  for (std::uint64_t bytes = 0; bytes < kMaxEventBytes; bytes += 60'000) {
    EXPECT_FALSE(other.runner->isFull());
    other.runner->receive(base::Bytes(60'000, 1), other.state());
  }
  EXPECT_TRUE(other.runner->isFull());
  busy.free();
  connection.next();
  EXPECT_FALSE(connection.runner->isFull());
}

TEST(SessionRunner, aRefusalIsToldOnceAndAfterItsMessage) {
  const TestScene scene;
  FairQueue workers(1);
  FakeConnection connection(scene.data, workers);
  connection.runner->receive({0x42, 0x13}, connection.state());
  const SessionOutput refusal = connection.next();
  ASSERT_EQ(refusal.messages.size(), 1U);
  EXPECT_TRUE(std::holds_alternative<protocol::Refusal>(*protocol::decodeServerMessage(refusal.messages[0])));
  ASSERT_TRUE(refusal.refusal);
  EXPECT_NE(*refusal.refusal, "");
  connection.runner->receive({0x42, 0x13}, connection.state());
  EXPECT_FALSE(connection.next().refusal);
}

TEST(SessionRunner, nothingComesAfterTheEnd) {
  const TestScene scene;
  FairQueue workers(1);
  int outputs = 0;
  const auto runner =
      std::make_shared<SessionRunner>(scene.data, nullptr, workers, 1, [&](const SessionOutput&) { ++outputs; });
  BusyThread busy(workers);
  runner->receive(protocol::encode(protocol::ClientMessage(protocol::Hello{})), {});
  runner->end();
  EXPECT_FALSE(runner->wake({}));
  EXPECT_FALSE(runner->isFull());
  busy.free();
  workers.stop();
  EXPECT_EQ(outputs, 0);
}

// Many viewers at once on several workers; the thread sanitizer looks on.
TEST(SessionRunner, manyViewersAtOnce) {
  const TestScene scene(8, 500);
  FairQueue workers(4);
  std::vector<std::unique_ptr<FakeConnection>> connections;
  for (std::uint64_t client = 1; client <= 16; ++client) {
    connections.push_back(std::make_unique<FakeConnection>(scene.data, workers, client));
    connections.back()->send(protocol::Hello{protocol::kVersion, "a program"});
    connections.back()->send(someView(1));
  }
  std::vector<std::thread> threads;
  for (const auto& connection : connections)
    threads.emplace_back([&connection] { EXPECT_GT(connection->readUntilComplete(1), 5U); });
  for (std::thread& thread : threads) thread.join();
}

// ---- A busy server

bool completes(Session& session, std::uint32_t sequence) {
  bool complete = false;
  while (const auto message = session.nextMessage()) {
    const auto decoded = protocol::decodeServerMessage(*message);
    const auto* completion = decoded ? std::get_if<protocol::Completion>(&*decoded) : nullptr;
    complete = complete || (completion != nullptr && completion->sequence == sequence);
  }
  return complete;
}

// While others wait, a motion is planned for as often as the scene says, while they work a little more often, and a
// jump at once.
TEST(BusySession, plansMotionsSeldom) {
  TestScene scene;
  scene.data.views_per_second = 20.0;
  for (const Load load : {Load::kFree, Load::kShared, Load::kBehind}) {
    Session session(scene.data);
    const auto look = [&](double seconds, std::uint32_t sequence, double x) {
      session.setLink({seconds, 0, 0, 0.0});
      protocol::View view = someView(sequence);
      view.camera.position.x += x;
      EXPECT_TRUE(session.receive(protocol::encode(protocol::ClientMessage(view))));
    };
    EXPECT_TRUE(session.receive(protocol::encode(protocol::ClientMessage(protocol::Hello{}))));
    session.setLoad(load);
    look(1.0, 1, 0.0);
    EXPECT_TRUE(completes(session, 1));
    look(1.03, 2, 0.5);
    EXPECT_EQ(completes(session, 2), load == Load::kFree);
    if (load != Load::kFree) {
      ASSERT_TRUE(session.wakeAt());
      EXPECT_NEAR(*session.wakeAt(), load == Load::kShared ? 1.0 + 1.0 / 30.0 : 1.05, 1e-9);
      session.setLink({1.1, 0, 0, 0.0});
      EXPECT_TRUE(completes(session, 2));
    }
    look(1.12, 3, 30.0);
    EXPECT_TRUE(completes(session, 3));
  }
}

// A plan for the motion costs as much as the view's own, which others wait for meanwhile.
TEST(BusySession, prefetchesWhenThereIsTime) {
  TestScene scene;
  Session session(scene.data);
  session.setLink({1.0, 0, 0, 0.0});
  EXPECT_TRUE(session.receive(protocol::encode(protocol::ClientMessage(protocol::Hello{}))));
  EXPECT_TRUE(session.receive(protocol::encode(protocol::ClientMessage(someView(1)))));
  session.setLoad(Load::kShared);
  EXPECT_TRUE(completes(session, 1));
  const std::uint64_t faces = session.counts().faces;
  session.setLink({1.1, 0, 0, 0.0});
  EXPECT_FALSE(session.nextMessage());
  ASSERT_TRUE(session.wakeAt());
  EXPECT_GT(*session.wakeAt(), 1.1);
  session.setLoad(Load::kFree);
  while (session.nextMessage()) continue;
  EXPECT_GT(session.counts().faces, faces);
  session.setLoad(Load::kShared);
  EXPECT_FALSE(session.nextMessage());
  EXPECT_FALSE(session.wakeAt()) << "nothing is left to prefetch";
}

}  // namespace
}  // namespace server
