#include "server/session/fair_queue.h"

#include <gtest/gtest.h>
#include <time.h>

#include <array>
#include <atomic>
#include <chrono>
#include <future>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace server {
namespace {

/// Keeps a thread of the queue until it is let go. The job may outlive this.
class Gate {
 public:
  FairQueue::Job job() {
    return [state = state_] {
      const std::future<void> opened = state->opened.get_future();
      state->begun.set_value();
      opened.wait();
    };
  }
  void waitUntilBegun() { state_->begun.get_future().wait(); }
  void open() { state_->opened.set_value(); }

 private:
  struct State {
    std::promise<void> begun, opened;
  };
  const std::shared_ptr<State> state_ = std::make_shared<State>();
};

/// Takes processor time of the thread, which is what the queue counts: on a busy machine a thread has less of it than
/// has passed.
void spend(std::chrono::milliseconds time) {
  const auto used = [] {
    timespec now{};
    ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return std::chrono::seconds(now.tv_sec) + std::chrono::nanoseconds(now.tv_nsec);
  };
  const auto end = used() + time;
  while (used() < end) {
  }
}

TEST(FairQueue, jobsOfAClientRunOneAfterTheOtherInTheirOrder) {
  FairQueue queue(4);
  std::atomic<int> running{0}, done{0};
  std::string order;
  std::promise<void> all;
  for (int i = 0; i < 100; ++i) {
    queue.submit(7, [&, i] {
      EXPECT_EQ(++running, 1);
      order += static_cast<char>('0' + i % 10);
      --running;
      if (++done == 100) all.set_value();
    });
  }
  all.get_future().wait();
  for (int i = 0; i < 100; ++i) EXPECT_EQ(order[static_cast<std::size_t>(i)], '0' + i % 10);
}

TEST(FairQueue, severalJobsOfAClientRunAtOnceWhereThatIsAllowed) {
  FairQueue queue(3, 2);
  Gate first, second;
  std::atomic<bool> third{false};
  queue.submit(1, first.job());
  queue.submit(1, second.job());
  queue.submit(1, [&] { third = true; });
  first.waitUntilBegun();
  second.waitUntilBegun();
  EXPECT_FALSE(third);
  EXPECT_EQ(queue.waiting(), 1U);
  first.open();
  second.open();
}

/// Jobs of a queue that note who ran.
class NotedJobs {
 public:
  NotedJobs(FairQueue& queue, std::size_t count) : queue_(queue), count_(count) {}
  void add(std::uint64_t client, char name, std::chrono::milliseconds time) {
    queue_.submit(client, [this, name, time] {
      spend(time);
      order_ += name;
      if (order_.size() == count_) all_.set_value();
    });
  }
  /// The names in the order in which all jobs ran, once they did.
  std::string order() {
    all_.get_future().wait();
    return order_;
  }

 private:
  FairQueue& queue_;
  const std::size_t count_;
  std::string order_;
  std::promise<void> all_;
};

// Ten jobs of a greedy client were there first. Once it was given time, the others come before its next job.
TEST(FairQueue, whoWasGivenLeastTimeComesNext) {
  FairQueue queue(1);
  Gate gate;
  queue.submit(99, gate.job());
  gate.waitUntilBegun();
  NotedJobs jobs(queue, 14);
  for (int i = 0; i < 10; ++i) jobs.add(1, 'g', std::chrono::milliseconds(20));
  for (int i = 0; i < 2; ++i) jobs.add(2, 'a', std::chrono::milliseconds(1));
  for (int i = 0; i < 2; ++i) jobs.add(3, 'b', std::chrono::milliseconds(1));
  gate.open();
  const std::string order = jobs.order();
  EXPECT_EQ(order.substr(0, 1), "g");
  EXPECT_EQ(order.substr(5), "ggggggggg") << order;
}

// A hundred clients of one address, with jobs as long as those of the one client of another.
TEST(FairQueue, manyClientsOfAnAddressAreServedAsAFew) {
  FairQueue queue(1);
  constexpr std::uint64_t kMany = 100;
  for (std::uint64_t client = 1; client <= kMany; ++client) queue.setAddress(client, "crowd");
  queue.setAddress(1000, "other");
  Gate gate;
  queue.submit(2000, gate.job());
  gate.waitUntilBegun();
  constexpr int kJobs = 10;
  std::atomic<int> of_crowd{0}, of_other{0}, before_last{0};
  std::promise<void> all;
  const auto end = [&] {
    if (of_crowd + of_other == kJobs * static_cast<int>(kMany + 1)) all.set_value();
  };
  for (int i = 0; i < kJobs; ++i)
    for (std::uint64_t client = 1; client <= kMany; ++client)
      queue.submit(client, [&] { spend(std::chrono::milliseconds(1)), ++of_crowd, end(); });
  for (int i = 0; i < kJobs; ++i)
    queue.submit(1000, [&] {
      spend(std::chrono::milliseconds(1));
      if (++of_other == kJobs) before_last = of_crowd.load();
      end();
    });
  gate.open();
  all.get_future().wait();
  // By clients alone it would be a hundred for each of the other's.
  EXPECT_LT(before_last, 500) << "of " << kJobs * kMany;
}

// While client 1 works, client 2 is idle. It does not come back with all that time saved up.
TEST(FairQueue, idleClientsSaveUpNoTime) {
  FairQueue queue(1);
  std::promise<void> worked;
  queue.submit(2, [] {});
  for (int i = 0; i < 5; ++i) queue.submit(1, [] { spend(std::chrono::milliseconds(20)); });
  queue.submit(1, [&] { worked.set_value(); });
  worked.get_future().wait();

  Gate gate;
  queue.submit(99, gate.job());
  gate.waitUntilBegun();
  NotedJobs jobs(queue, 8);
  for (int i = 0; i < 4; ++i) jobs.add(2, 'b', std::chrono::milliseconds(10));
  for (int i = 0; i < 4; ++i) jobs.add(1, 'a', std::chrono::milliseconds(10));
  gate.open();
  const std::string order = jobs.order();
  EXPECT_NE(order, "bbbbaaaa");
}

TEST(FairQueue, forgottenClientsHaveNoJobs) {
  FairQueue queue(1);
  Gate gate;
  std::atomic<bool> ran{false};
  queue.submit(1, gate.job());
  queue.submit(1, [&] { ran = true; });
  gate.waitUntilBegun();
  EXPECT_EQ(queue.waiting(), 1U);
  queue.forget(1);
  EXPECT_EQ(queue.waiting(), 0U);
  gate.open();
  std::promise<void> later;
  queue.submit(2, [&] { later.set_value(); });
  later.get_future().wait();
  EXPECT_FALSE(ran);
}

TEST(FairQueue, aJobMayForgetItsOwnClient) {
  FairQueue queue(2);
  std::promise<void> done;
  queue.submit(1, [&] {
    queue.submit(1, [] { FAIL(); });
    queue.forget(1);
    done.set_value();
  });
  done.get_future().wait();
}

// Clients whose jobs replace each other get their turns all the same, whatever their numbers are.
TEST(FairQueue, droppedJobsLeaveTheClientKnown) {
  FairQueue queue(1);
  std::array<std::atomic<int>, 4> ran{};
  std::atomic<bool> stop{false};
  std::vector<std::thread> clients;
  for (std::uint64_t client = 0; client < ran.size(); ++client)
    clients.emplace_back([&, client] {
      while (!stop) {
        std::promise<void> done;
        auto over = done.get_future();
        queue.drop(client);
        queue.submit(client, [&] {
          spend(std::chrono::milliseconds(2));
          ++ran[client];
          done.set_value();
        });
        over.wait();
      }
    });
  while (ran[0] + ran[1] + ran[2] + ran[3] < 100) std::this_thread::yield();
  stop = true;
  for (std::thread& client : clients) client.join();
  for (const auto& times : ran) EXPECT_GT(times, 10);
}

TEST(FairQueue, isBehindWhereMoreClientsWaitThanThreads) {
  FairQueue queue(1);
  Gate gate;
  queue.submit(1, gate.job());
  gate.waitUntilBegun();
  EXPECT_FALSE(queue.isBehind());
  queue.submit(2, [] {});
  EXPECT_FALSE(queue.isBehind());
  queue.submit(3, [] {});
  EXPECT_TRUE(queue.isBehind());
  gate.open();
}

TEST(FairQueue, hasAFreeThreadWhereNobodyWaitsAndOneIsIdle) {
  FairQueue one(1), two(2);
  Gate gate, first, second;
  EXPECT_TRUE(one.hasFreeThread());
  one.submit(1, gate.job());
  gate.waitUntilBegun();
  EXPECT_TRUE(one.hasFreeThread()) << "a thread that is alone is free for the job that it does";
  one.submit(2, [] {});
  EXPECT_FALSE(one.hasFreeThread());
  gate.open();

  two.submit(1, first.job());
  first.waitUntilBegun();
  EXPECT_TRUE(two.hasFreeThread());
  two.submit(2, second.job());
  second.waitUntilBegun();
  EXPECT_FALSE(two.hasFreeThread());
  first.open();
  second.open();
}

// Two viewers of a scene whose disk hangs have both threads, and two more wait. The viewer of another scene is served,
// again and again, and the rest of the first scene's when the disk is back.
TEST(FairQueue, aGroupThatHangsKeepsNoOther) {
  FairQueue queue(2);
  for (const std::uint64_t client : {1, 2, 3, 4}) queue.setGroup(client, 7);
  queue.setGroup(5, 8);
  Gate first, second;
  std::atomic<int> late{0};
  std::promise<void> all_late;
  queue.submit(1, first.job());
  queue.submit(2, second.job());
  for (const std::uint64_t client : {3, 4})
    queue.submit(client, [&] {
      if (++late == 2) all_late.set_value();
    });
  first.waitUntilBegun();
  second.waitUntilBegun();
  for (int i = 0; i < 10; ++i) {
    std::promise<void> done;
    auto over = done.get_future();
    queue.submit(5, [&] { done.set_value(); });
    ASSERT_EQ(over.wait_for(std::chrono::seconds(20)), std::future_status::ready) << "job " << i;
  }
  EXPECT_EQ(late, 0) << "a group has as many threads as there are, even if it hangs";
  EXPECT_FALSE(queue.isBehind()) << "who waits for the disk does not wait for threads";
  first.open();
  second.open();
  EXPECT_EQ(all_late.get_future().wait_for(std::chrono::seconds(20)), std::future_status::ready);
}

// One client's job hangs for two seconds, and so does their common disk. Who works for less than one then comes before
// it for a part of that only.
TEST(FairQueue, timeThatAJobHangsIsNotCharged) {
  FairQueue queue(1);
  queue.setGroup(1, 7);
  queue.setGroup(2, 7);
  Gate hangs;
  queue.submit(1, hangs.job());
  hangs.waitUntilBegun();
  NotedJobs jobs(queue, 9);
  for (int i = 0; i < 8; ++i) jobs.add(2, 'b', std::chrono::milliseconds(100));
  jobs.add(1, 'a', std::chrono::milliseconds(1));
  std::this_thread::sleep_for(4 * FairQueue::kStallTime);
  hangs.open();
  const std::string order = jobs.order();
  EXPECT_LT(order.find('a'), 8U) << order;
}

TEST(FairQueue, stopDropsWhatWaitsAndWhatComesLater) {
  FairQueue queue(1);
  Gate gate;
  std::atomic<bool> ran{false};
  queue.submit(1, gate.job());
  gate.waitUntilBegun();
  queue.submit(2, [&] { ran = true; });
  std::thread stopper([&] { queue.stop(); });
  while (queue.waiting() != 0) std::this_thread::yield();
  gate.open();
  stopper.join();
  queue.submit(3, [&] { ran = true; });
  EXPECT_EQ(queue.waiting(), 0U);
  EXPECT_FALSE(ran);
}

// Many clients come and go; what is known of them stays bounded, and all jobs run.
TEST(FairQueue, manyClients) {
  FairQueue queue(4);
  std::atomic<int> ran{0};
  std::promise<void> all;
  for (std::uint64_t client = 0; client < 20'000; ++client)
    queue.submit(client, [&] {
      if (++ran == 20'000) all.set_value();
    });
  all.get_future().wait();
  EXPECT_EQ(ran, 20'000);
}

}  // namespace
}  // namespace server
