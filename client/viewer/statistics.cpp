#include "client/viewer/statistics.h"

#include <array>

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

/// Adds the lines about the link of a streamed method.
void addLinkLines(const Statistics& s, std::vector<StatisticsLine>& lines) {
  lines.push_back({"received", formatBytes(s.viewer.session.bytes_received)});
  lines.push_back({"link", formatText("%.1f Mbit/s", s.megabits_per_second)});
  if (s.viewer.broken > 0) lines.push_back({"broken", s.viewer.last_fault});
}

/// The lines of a viewer that shows splats.
std::vector<StatisticsLine> splatLines(const Statistics& s) {
  const ViewerStats& viewer = s.viewer;
  const SplatStats& splats = viewer.streamed.splats;
  const auto px = [](const char* pattern, float value) { return formatText(pattern, static_cast<double>(value)); };
  std::vector<StatisticsLine> lines{
      {"picture", pictureText(viewer)},
      {"frames", framesText(s)},
      {"splats", formatCount(viewer.streamed.drawn, ' ') + px(", down to %.1f px", viewer.error_px) +
                     (splats.reduction > 1.0F ? px(", one sample for %.1f px", splats.reduction) : std::string()) +
                     (splats.lens_px > 0.0F ? px(", %.1f in the glass", splats.lens_px) : std::string())},
      {"blocks", formatCount(splats.stream.present, ' ') + " of " + formatCount(splats.stream.blocks, ' ') + " here, " +
                     formatCount(splats.stream.requested, ' ') + " requested, " +
                     formatCount(splats.stream.wanted, ' ') + " wanted"},
      {"memory", memoryText(viewer) + (viewer.streamed.limited ? ": finer splats need more" : "")}};
  addLinkLines(s, lines);
  return lines;
}

/// The lines of a viewer that shows points and umbrellas.
std::vector<StatisticsLine> umbrellaLines(const Statistics& s) {
  const ViewerStats& viewer = s.viewer;
  const UmbrellaStats& umbrellas = viewer.streamed.umbrellas;
  std::vector<StatisticsLine> lines{
      {"picture", pictureText(viewer)},
      {"frames", framesText(s)},
      {"umbrellas", formatCount(umbrellas.triangles, ' ') + " triangles, " + formatCount(umbrellas.points, ' ') +
                        " points" + formatText(", of %.1f px", static_cast<double>(viewer.error_px))},
      {"leaves", formatCount(umbrellas.leaves, ' ') + " in view, " + formatCount(umbrellas.stream.present, ' ') +
                     " of " + formatCount(umbrellas.stream.leaves, ' ') + " here, " +
                     formatCount(umbrellas.stream.lacking, ' ') + " to be refined"},
      {"memory", memoryText(viewer) + (viewer.streamed.limited ? ": a finer picture needs more" : "")}};
  addLinkLines(s, lines);
  return lines;
}

}  // namespace

std::vector<StatisticsLine> statisticsLines(const Statistics& s) {
  const ViewerStats& viewer = s.viewer;
  if (viewer.streamed.splats.stream.blocks > 0) return splatLines(s);
  if (viewer.streamed.umbrellas.stream.leaves > 0) return umbrellaLines(s);
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
