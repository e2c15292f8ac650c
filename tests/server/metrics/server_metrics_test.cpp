#include "server/metrics/server_metrics.h"

#include <gtest/gtest.h>

#include <regex>
#include <sstream>

namespace server {
namespace {

// The value behind `sample` in the text; -1 where it is not there.
double valueOf(const std::string& text, const std::string& sample) {
  const std::size_t at = ("\n" + text).find("\n" + sample + " ");
  return at == std::string::npos ? -1.0 : std::stod(text.substr(at + sample.size()));
}

TEST(ServerMetrics, theProcessIsDescribed) {
  const ServerMetrics metrics;
  const std::string text = metrics.all.text();
  EXPECT_GT(valueOf(text, "process_resident_memory_bytes"), 1e6);
  EXPECT_GE(valueOf(text, "process_open_fds"), 3.0);
  EXPECT_GE(valueOf(text, "process_threads"), 1.0);
  EXPECT_GT(valueOf(text, "process_start_time_seconds"), 1.7e9);
  EXPECT_NE(text.find("lumigrid_build_info{version=\"0."), std::string::npos) << text;
}

TEST(ServerMetrics, aSessionAddsWhatItsNumbersGrewBy) {
  ServerMetrics metrics;
  SessionReporter first(metrics.scene("tower")), second(metrics.scene("tower"));
  first.report({.views = 2, .face_bytes = 100});
  first.report({.views = 3, .face_bytes = 150, .damaged = 1});
  second.report({.views = 10});
  const std::string text = metrics.all.text();
  EXPECT_EQ(valueOf(text, "lumigrid_views_received_total{scene=\"tower\"}"), 13.0);
  EXPECT_EQ(valueOf(text, "lumigrid_sent_bytes_total{kind=\"face\",scene=\"tower\"}"), 150.0);
  EXPECT_EQ(valueOf(text, "lumigrid_damaged_total{scene=\"tower\"}"), 1.0);
}

TEST(ServerMetrics, queuesAndCachesAreReadWhenTheTextIsMade) {
  ServerMetrics metrics;
  metrics.readQueue("frames", [] { return 4.0; });
  metrics.readCache("frames", [] { return std::pair<std::uint64_t, std::uint64_t>(3, 2); });
  const std::string text = metrics.all.text();
  EXPECT_EQ(valueOf(text, "lumigrid_queue_length{queue=\"frames\"}"), 4.0);
  EXPECT_EQ(valueOf(text, "lumigrid_cache_lookups_total{cache=\"frames\",outcome=\"hit\"}"), 3.0);
  EXPECT_EQ(valueOf(text, "lumigrid_cache_lookups_total{cache=\"frames\",outcome=\"miss\"}"), 2.0);
}

// promtool has the same opinion of what a line is.
TEST(ServerMetrics, eachLineHasTheFormOfOne) {
  ServerMetrics metrics;
  metrics.scene("tower \"of\" Pisa");
  metrics.refused("connections").add();
  metrics.answers(200).add();
  const std::regex comment("# (HELP|TYPE) [a-z_]+ .+");
  const std::regex sample(R"re([a-z_]+(\{([a-z]+="([^"\\]|\\.)*",?)+\})? ([-+0-9.e]+|NaN|\+Inf))re");
  std::istringstream lines(metrics.all.text());
  int samples = 0;
  for (std::string line; std::getline(lines, line);) {
    const bool is_comment = line.starts_with('#');
    EXPECT_TRUE(std::regex_match(line, is_comment ? comment : sample)) << line;
    samples += is_comment ? 0 : 1;
  }
  EXPECT_GT(samples, 50);
}

}  // namespace
}  // namespace server
