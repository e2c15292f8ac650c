#include "server/session/timed_tasks.h"

#include <gtest/gtest.h>

#include <atomic>
#include <future>

namespace server {
namespace {

TEST(TimedTasks, waitsForAllThatEnd) {
  std::atomic<int> done{0};
  TimedTasks tasks;
  for (const char* name : {"one", "two", "three"}) tasks.add(name, [&] { ++done; });
  EXPECT_TRUE(tasks.wait(20.0).empty());
  EXPECT_EQ(done, 3);
}

TEST(TimedTasks, namesThoseThatHang) {
  std::promise<void> gate;
  TimedTasks tasks;
  tasks.add("quick", [] {});
  tasks.add("hangs", [&] { gate.get_future().wait(); });
  std::vector<std::string> late = tasks.wait(0.01);
  while (late.size() > 1) late = tasks.wait(0.01);
  EXPECT_EQ(late, std::vector<std::string>{"hangs"});
  gate.set_value();
  EXPECT_TRUE(tasks.wait(20.0).empty());
}

// Whoever waited may end all that the tasks used.
TEST(TimedTasks, holdNothingOnceTheyHaveEnded) {
  auto held = std::make_shared<int>(1);
  const std::weak_ptr<int> seen = held;
  TimedTasks tasks;
  tasks.add("holds", [held] {});
  held.reset();
  EXPECT_TRUE(tasks.wait(20.0).empty());
  EXPECT_TRUE(seen.expired());
}

}  // namespace
}  // namespace server
