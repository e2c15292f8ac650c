#include "compare/sim/equal_bytes.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace compare {
namespace {

/// The 97.5 % quantile of Student's t distribution with `degrees` of freedom, 1 or more; beyond the table that of the
/// normal distribution, which is 4 % less at its end.
double studentQuantile(std::size_t degrees) {
  constexpr std::array kTable{12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228,
                              2.201,  2.179, 2.160, 2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086,
                              2.080,  2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042};
  return degrees <= kTable.size() ? kTable[degrees - 1] : 1.96;
}

double logBytes(const PlayedRun& run) {
  return std::log(std::max<double>(1.0, static_cast<double>(run.frames.back().counts.bytes)));
}

/// The two runs of a method around so many bytes, fewer first; nothing where they do not enclose them.
std::optional<std::pair<const PlayedRun*, const PlayedRun*>> runsAround(const std::vector<const PlayedRun*>& runs,
                                                                        const std::string& method, double log_bytes) {
  const PlayedRun *below = nullptr, *above = nullptr;
  for (const PlayedRun* run : runs) {
    if (run->setting.method != method) continue;
    const double its = logBytes(*run);
    if (its <= log_bytes && (below == nullptr || its > logBytes(*below))) below = run;
    if (its >= log_bytes && (above == nullptr || its < logBytes(*above))) above = run;
  }
  if (below == nullptr || above == nullptr) return std::nullopt;
  return std::pair(below, above);
}

/// The mean of values and half the width of its interval.
BytesDifference summarize(const std::string& method, const std::vector<double>& values) {
  const auto n = static_cast<double>(values.size());
  double sum = 0.0, squares = 0.0;
  for (const double value : values) sum += value;
  for (const double value : values) squares += (value - sum / n) * (value - sum / n);
  const double deviation = std::sqrt(squares / (n - 1.0));
  return {method, sum / n, studentQuantile(values.size() - 1) * deviation / std::sqrt(n)};
}

}  // namespace

std::vector<BytesDifference> differencesAtBytesOf(const PlayedRun& reference,
                                                  const std::vector<const PlayedRun*>& runs) {
  std::vector<BytesDifference> differences;
  std::vector<std::string> done{reference.setting.method};
  const double at = logBytes(reference);
  const auto frames = reference.moving();
  for (const PlayedRun* run : runs) {
    const std::string& method = run->setting.method;
    if (std::find(done.begin(), done.end(), method) != done.end()) continue;
    done.push_back(method);
    const auto around = runsAround(runs, method, at);
    if (!around) continue;
    const auto below = around->first->moving(), above = around->second->moving();
    if (frames.size() < 2 || below.size() != frames.size() || above.size() != frames.size()) continue;
    const double width = logBytes(*around->second) - logBytes(*around->first);
    const double share = width > 0.0 ? (at - logBytes(*around->first)) / width : 0.0;
    std::vector<double> values;
    for (std::size_t i = 0; i < frames.size(); ++i)
      values.push_back(frames[i]->accuracy.psnr_db - (1.0 - share) * below[i]->accuracy.psnr_db -
                       share * above[i]->accuracy.psnr_db);
    differences.push_back(summarize(method, values));
  }
  return differences;
}

}  // namespace compare
