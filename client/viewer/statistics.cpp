#include "client/viewer/statistics.h"

#include <array>
#include <utility>

#include "base/format_text.h"
#include "base/text.h"

namespace client {
namespace {

using base::formatBytes;
using base::formatCount;
using base::formatText;

std::string pictureText(const ViewerStats& s) {
  static constexpr std::array<const char*, 5> kNames{"nothing yet", "coarse", "blended", "exact", "fine"};
  const std::string name = kNames[static_cast<std::size_t>(s.accuracy)];
  return s.complete ? name + ", complete" : name + ", more on its way";
}

std::string memoryText(const ViewerStats& s) {
  return formatBytes(s.memory.total()) + " of " + formatBytes(s.memory_budget);
}

std::string framesText(const Statistics& s) {
  return s.frames_per_second > 0.0
             ? formatText("%.0f per second, %.1f ms each", s.frames_per_second, s.frame_milliseconds)
             : formatText("at rest, %.1f ms the last", s.frame_milliseconds);
}

/// The lines of a viewer that shows a streamed method.
std::vector<StatisticsLine> streamedLines(const Statistics& s) {
  const ViewerStats& viewer = s.viewer;
  std::vector<StatisticsLine> lines{{"picture", pictureText(viewer)}, {"frames", framesText(s)}};
  for (StatisticsLine& line : viewer.streamed.describe(viewer.streamed)) lines.push_back(std::move(line));
  lines.push_back({"memory", memoryText(viewer) + (viewer.streamed.limited ? ": a finer picture needs more" : "")});
  lines.push_back({"received", formatBytes(viewer.session.bytes_received)});
  lines.push_back({"link", formatText("%.1f Mbit/s", s.megabits_per_second)});
  if (viewer.broken > 0) lines.push_back({"broken", viewer.last_fault});
  return lines;
}

}  // namespace

std::vector<StatisticsLine> statisticsLines(const Statistics& s) {
  const ViewerStats& viewer = s.viewer;
  if (viewer.streamed.describe != nullptr) return streamedLines(s);
  const LumigraphStats& drawn = viewer.lumigraph;
  const SessionStats& session = viewer.session;
  std::vector<StatisticsLine> lines{
      {"picture", pictureText(viewer)},
      {"frames", framesText(s)},
      {"images", formatText("%u in use, %u resident, %u requested", drawn.samples_used, drawn.samples_resident,
                            viewer.images_requested)},
      {"found here", formatText("%.0f %% of images", 1e2 * s.hit_rate)},
      {"patches", formatText("%u, ", drawn.patches) + formatCount(drawn.triangles, ' ') + " triangles"},
      {"screen error", formatText("%.2f px, nowhere above %.1f", static_cast<double>(viewer.error_px),
                                  static_cast<double>(viewer.bound_px))},
      {"memory", memoryText(viewer)},
      {"graphics", formatBytes(viewer.memory.gpu()) + " of these"},
      {"received", formatBytes(session.bytes_received) + ": images " + formatBytes(session.bytes_faces) + ", patches " +
                       formatBytes(session.bytes_patches) + ", exact " + formatBytes(session.bytes_frames)},
      {"link", formatText("%.1f Mbit/s, ", s.megabits_per_second) +
                   (s.round_trip_milliseconds > 0.0 ? formatText("%.0f ms round trip", s.round_trip_milliseconds)
                                                    : std::string("round trip not measured"))}};
  if (viewer.broken > 0) lines.push_back({"broken", formatText("%u, the last: ", viewer.broken) + viewer.last_fault});
  return lines;
}

}  // namespace client
