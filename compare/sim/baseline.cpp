#include "compare/sim/baseline.h"

#include <array>
#include <map>
#include <optional>

#include "base/format_text.h"
#include "base/number.h"
#include "compare/csv.h"

namespace compare {
namespace {

using Row = std::map<std::string, std::string>;  // by column
using Table = std::map<std::string, Row>;        // by scene, method, knob, path and link

constexpr std::array<const char*, 5> kKey{"scene", "method", "knob", "path", "link"};
constexpr std::array<const char*, 3> kAccuracies{"mean_psnr_db", "p5_psnr_db", "at_rest_psnr_db"};
constexpr std::array<const char*, 1> kByteCounts{"bytes"};
constexpr std::array<const char*, 5> kTimes{"time_to_first_s", "time_to_25_s", "time_to_30_s", "time_to_35_s",
                                            "rest_s"};

std::optional<Table> parseTable(const std::string& text) {
  const auto csv = parseCsv(text);
  if (!csv) return std::nullopt;
  Table table;
  for (const Row& row : csv->rows) {
    std::string key;
    for (const char* name : kKey) {
      if (!row.contains(name)) return std::nullopt;
      key += (key.empty() ? "" : " ") + row.at(name);
    }
    table[key] = row;
  }
  return table;
}

/// Compares the figures of one run.
class Comparison {
 public:
  Comparison(const std::string& key, const Row& now, const Row& then, std::vector<std::string>& losses)
      : key_(key), now_(now), then_(then), losses_(losses) {}

  void check(const char* column, double share, double amount, bool less_is_worse) {
    const auto then = figure(then_, column);
    if (!then) return;  // it was not reached then
    const auto now = figure(now_, column);
    if (!now) return lose(column, *then, "not reached");
    const double allowed = less_is_worse ? *then - amount : *then * (1.0 + share) + amount;
    if (less_is_worse ? *now < allowed : *now > allowed) lose(column, *then, base::formatText("%.3f", *now));
  }

 private:
  static std::optional<double> figure(const Row& row, const char* column) {
    const auto it = row.find(column);
    return it == row.end() ? std::nullopt : base::parseNumber(it->second);
  }
  void lose(const char* column, double then, const std::string& now) {
    losses_.push_back(base::formatText("%-64s %-16s %12.3f -> %12s", key_.c_str(), column, then, now.c_str()));
  }

  const std::string& key_;
  const Row& now_;
  const Row& then_;
  std::vector<std::string>& losses_;
};

}  // namespace

base::Result<std::vector<std::string>> findLosses(const std::string& summary, const std::string& baseline,
                                                  const std::string& name, const GateLimits& limits) {
  const auto now = parseTable(summary), then = parseTable(baseline);
  if (!then || then->empty() || !now)
    return base::Error{base::ErrorCode::kInvalidInput,
                       name + ": is no summary.csv of this program; copy the one of a report there"};
  std::vector<std::string> losses;
  for (const auto& [key, row] : *then) {
    const auto found = now->find(key);
    if (found == now->end()) {
      losses.push_back(key + ": was not played");
      continue;
    }
    Comparison comparison(key, found->second, row, losses);
    for (const char* column : kAccuracies) comparison.check(column, 0.0, limits.db, true);
    for (const char* column : kByteCounts) comparison.check(column, limits.share, limits.bytes, false);
    for (const char* column : kTimes) comparison.check(column, limits.share, limits.seconds, false);
  }
  for (const auto& [key, row] : *now)
    if (!then->contains(key)) losses.push_back(key + ": is not in the baseline");
  return losses;
}

}  // namespace compare
