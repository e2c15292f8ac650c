#include "client/viewer/statistics.h"

#include <array>
#include <cstdarg>
#include <cstdio>

#include "base/text.h"

namespace client {
namespace {

using base::formatBytes;
using base::formatCount;

__attribute__((format(printf, 1, 2))) std::string format(const char* pattern, ...) {
  std::array<char, 256> buffer{};
  va_list values;
  va_start(values, pattern);
  std::vsnprintf(buffer.data(), buffer.size(), pattern, values);
  va_end(values);
  return buffer.data();
}

std::string pictureText(const Statistics& s) {
  const std::string name(accuracyName(s.accuracy));
  return s.complete ? name + ", complete" : name + ", more on its way";
}

std::string framesText(const Statistics& s) {
  return s.frames_per_second > 0.0 ? format("%.0f per second, %.1f ms each", s.frames_per_second, s.frame_milliseconds)
                                   : format("at rest, %.1f ms the last", s.frame_milliseconds);
}

}  // namespace

std::string_view accuracyName(Accuracy accuracy) {
  static constexpr std::array<std::string_view, 5> kNames{"nothing yet", "coarse", "blended", "exact", "fine"};
  return kNames[static_cast<std::size_t>(accuracy)];
}

namespace {

/// The lines of a viewer that shows splats.
std::vector<StatisticsLine> splatLines(const Statistics& s) {
  std::vector<StatisticsLine> lines{
      {"picture", pictureText(s)},
      {"frames", framesText(s)},
      {"splats", formatCount(s.splats, ' ') + format(", down to %.1f px", s.error_px) +
                     (s.reduction > 1.0 ? format(", one sample for %.1f px", s.reduction) : std::string()) +
                     (s.lens_px > 0.0 ? format(", %.1f in the glass", s.lens_px) : std::string())},
      {"blocks", formatCount(s.blocks_present, ' ') + " of " + formatCount(s.blocks, ' ') + " here, " +
                     formatCount(s.blocks_requested, ' ') + " requested, " + formatCount(s.blocks_wanted, ' ') +
                     " wanted"},
      {"memory", formatBytes(s.memory_bytes) + " of " + formatBytes(s.memory_budget) +
                     (s.limited ? ": finer splats need more" : "")},
      {"received", formatBytes(s.received_bytes)},
      {"link", format("%.1f Mbit/s", s.megabits_per_second)}};
  if (s.broken > 0) lines.push_back({"broken", s.last_fault});
  return lines;
}

}  // namespace

std::vector<StatisticsLine> statisticsLines(const Statistics& s) {
  if (s.blocks > 0) return splatLines(s);
  std::vector<StatisticsLine> lines{
      {"picture", pictureText(s)},
      {"frames", framesText(s)},
      {"images",
       format("%u in use, %u resident, %u requested", s.images_in_use, s.images_resident, s.images_requested)},
      {"found here", format("%.0f %% of images", 1e2 * s.hit_rate)},
      {"patches", format("%u, ", s.patches) + formatCount(s.triangles, ' ') + " triangles"},
      {"screen error", format("%.2f px", s.error_px)},
      {"memory", formatBytes(s.memory_bytes) + " of " + formatBytes(s.memory_budget)},
      {"graphics", formatBytes(s.gpu_bytes) + " of these"},
      {"received", formatBytes(s.received_bytes) + ": images " + formatBytes(s.received_images) + ", patches " +
                       formatBytes(s.received_patches) + ", exact " + formatBytes(s.received_frames)},
      {"link", format("%.1f Mbit/s, ", s.megabits_per_second) +
                   (s.round_trip_milliseconds > 0.0 ? format("%.0f ms round trip", s.round_trip_milliseconds)
                                                    : std::string("round trip not measured"))}};
  if (s.broken > 0) lines.push_back({"broken", format("%u, the last: ", s.broken) + s.last_fault});
  return lines;
}

}  // namespace client
