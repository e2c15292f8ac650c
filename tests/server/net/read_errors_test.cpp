#include "server/scene/read_errors.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "spdlog/sinks/ostream_sink.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

/// Collects the log's lines as long as it lives.
class CollectedLog {
 public:
  CollectedLog() {
    auto logger = std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(text_));
    logger->set_pattern("%v");
    spdlog::set_default_logger(std::move(logger));
  }
  ~CollectedLog() { spdlog::set_default_logger(before_); }
  CollectedLog(const CollectedLog&) = delete;
  CollectedLog& operator=(const CollectedLog&) = delete;

  std::string text() const { return text_.str(); }
  std::size_t lines() const {
    const std::string lines = text();
    return static_cast<std::size_t>(std::count(lines.begin(), lines.end(), '\n'));
  }

 private:
  std::shared_ptr<spdlog::logger> before_ = spdlog::default_logger();
  std::ostringstream text_;
};

base::Error errorOf(int number) {
  return {base::ErrorCode::kIo, "scene/patch.lgp: error " + std::to_string(number)};
}

TEST(ReadErrors, eachMessageIsLoggedOnceAndAllAreCounted) {
  const CollectedLog log;
  ReadErrors errors;
  for (int again = 0; again < 5; ++again)
    for (int number = 0; number < 3; ++number) errors.report("download", errorOf(number));
  EXPECT_EQ(errors.count(), 15U);
  EXPECT_EQ(log.text(),
            "download: scene/patch.lgp: error 0\ndownload: scene/patch.lgp: error 1\ndownload: scene/patch.lgp: error "
            "2\n");
}

TEST(ReadErrors, countOnInTheCounterOfReplacedScenes) {
  const CollectedLog log;
  std::uint64_t total = 0;
  const auto add = [&](std::uint64_t count) { total += count; };
  {
    ReadErrors replaced;
    replaced.report("image", errorOf(1));
    replaced.countIn(add);
    replaced.report("image", errorOf(1));
  }
  ReadErrors errors;
  errors.countIn(add);
  errors.report("image", errorOf(1));
  EXPECT_EQ(total, 3U);
}

TEST(ReadErrors, aHundredDifferentMessagesAreLogged) {
  const CollectedLog log;
  ReadErrors errors;
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      for (int i = 0; i < 100; ++i) errors.report("image", errorOf(100 * t + i));
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(errors.count(), 400U);
  EXPECT_EQ(log.lines(), 101U) << "and one that says that no more follow";
}

}  // namespace
}  // namespace server
