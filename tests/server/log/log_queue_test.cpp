#include "server/log/log_queue.h"

#include <gtest/gtest.h>

#include <vector>

namespace server {
namespace {

bool push(LogQueue& queue, const std::string& text) {
  return queue.push({{}, LogLevel::kInfo, text});
}

std::vector<std::string> popAll(LogQueue& queue) {
  std::vector<std::string> texts;
  while (auto entry = queue.pop()) texts.push_back(entry->text);
  return texts;
}

TEST(LogQueue, linesLeaveInTheirOrder) {
  LogQueue queue(10, 100);
  push(queue, "a");
  push(queue, "b");
  EXPECT_EQ(popAll(queue), (std::vector<std::string>{"a", "b"}));
  EXPECT_TRUE(queue.empty());
}

TEST(LogQueue, whereLinesWereDroppedALineSaysHowMany) {
  LogQueue queue(2, 100);
  EXPECT_TRUE(push(queue, "a"));
  EXPECT_TRUE(push(queue, "b"));
  EXPECT_FALSE(push(queue, "c"));
  EXPECT_FALSE(push(queue, "d"));
  EXPECT_EQ(queue.pop()->text, "a");
  EXPECT_TRUE(push(queue, "e"));
  EXPECT_FALSE(push(queue, "f"));
  EXPECT_EQ(popAll(queue), (std::vector<std::string>{"b", "2 lines were dropped: whoever reads the log is too slow",
                                                     "e", "1 line was dropped: whoever reads the log is too slow"}));
  EXPECT_TRUE(queue.empty());
}

TEST(LogQueue, bytesAreBounded) {
  LogQueue queue(1000, 100);
  for (int i = 0; i < 100; ++i) push(queue, std::string(10, 'x'));
  EXPECT_EQ(queue.size(), 10U);
  popAll(queue);
  EXPECT_TRUE(push(queue, std::string(1000, 'x'))) << "one line fits always";
  EXPECT_FALSE(push(queue, "y"));
}

}  // namespace
}  // namespace server
