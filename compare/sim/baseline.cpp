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
constexpr std::array<const char*, 2> kMoving{"mean_psnr_db", "p5_psnr_db"};
constexpr std::array<const char*, 3> kLevels{"time_to_25_s", "time_to_30_s", "time_to_35_s"};
constexpr std::array<const char*, 2> kTimes{"time_to_first_s", "rest_s"};

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

std::optional<double> figureOf(const Row& row, const char* column) {
  const auto it = row.find(column);
  return it == row.end() ? std::nullopt : base::parseNumber(it->second);
}

class Comparison {
 public:
  /// The lines that say what got worse are appended to `losses`.
  explicit Comparison(std::vector<std::string>& losses) : losses_(losses) {}

  /// The key is that of one run, or of a method on all its paths.
  void accuracy(const std::string& key, const char* column, std::optional<double> then, std::optional<double> now,
                double limit) {
    if (then && now && *now < *then - limit) lose(key, column, *then, base::formatText("%.3f", *now));
    if (then && !now) lose(key, column, *then, "not reached");
  }
  void cost(const std::string& key, const char* column, std::optional<double> then, std::optional<double> now,
            double share, double amount) {
    if (then && now && *now > *then * (1.0 + share) + amount) lose(key, column, *then, base::formatText("%.3f", *now));
    if (then && !now) lose(key, column, *then, "not reached");
  }

 private:
  void lose(const std::string& key, const char* column, double then, const std::string& now) {
    losses_.push_back(base::formatText("%-64s %-16s %12.3f -> %12s", key.c_str(), column, then, now.c_str()));
  }

  std::vector<std::string>& losses_;
};

/// The figures while the eye moves, of one method on all paths.
struct Moving {
  int paths = 0;
  std::array<double, kMoving.size()> then{}, now{};
};

}  // namespace

base::Result<std::vector<std::string>> findLosses(const std::string& summary, const std::string& baseline,
                                                  const std::string& name, const GateLimits& limits) {
  const auto now = parseTable(summary), then = parseTable(baseline);
  if (!then || then->empty() || !now)
    return base::Error{base::ErrorCode::kInvalidInput,
                       name + ": is no summary.csv of this program; copy the one of a report there"};
  std::vector<std::string> losses;
  Comparison comparison(losses);
  std::map<std::string, Moving> methods;
  for (const auto& [key, row] : *then) {
    const auto found = now->find(key);
    if (found == now->end()) {
      losses.push_back(key + ": was not played");
      continue;
    }
    const auto past = [&row = row](const char* column) { return figureOf(row, column); };
    const auto today = [&found](const char* column) { return figureOf(found->second, column); };
    Moving& moving = methods[row.at("scene") + " " + row.at("method") + " " + row.at("knob") + " " + row.at("link")];
    moving.paths++;
    for (std::size_t i = 0; i < kMoving.size(); i++) {
      comparison.accuracy(key, kMoving[i], past(kMoving[i]), today(kMoving[i]), limits.path_db);
      moving.then[i] += past(kMoving[i]).value_or(0.0);
      moving.now[i] += today(kMoving[i]).value_or(0.0);
    }
    comparison.accuracy(key, "at_rest_psnr_db", past("at_rest_psnr_db"), today("at_rest_psnr_db"), limits.db);
    comparison.cost(key, "bytes", past("bytes"), today("bytes"), limits.share, limits.bytes);
    for (const char* column : kTimes)
      comparison.cost(key, column, past(column), today(column), limits.share, limits.seconds);
    for (const char* column : kLevels)
      if (!today(column)) comparison.accuracy(key, column, past(column), today(column), limits.db);
  }
  for (const auto& [key, moving] : methods)
    for (std::size_t i = 0; i < kMoving.size(); i++)
      comparison.accuracy(key, (std::string("mean of ") + kMoving[i]).c_str(), moving.then[i] / moving.paths,
                          moving.now[i] / moving.paths, limits.db);
  for (const auto& [key, row] : *now)
    if (!then->contains(key)) losses.push_back(key + ": is not in the baseline");
  return losses;
}

}  // namespace compare
