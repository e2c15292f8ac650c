#include "compare/sim/play.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "base/file.h"
#include "base/format_text.h"
#include "base/jpeg/jpeg.h"
#include "base/png/png.h"
#include "base/stopwatch.h"
#include "server/bake/face_encoder.h"
#include "server/views/random_views.h"

namespace compare {
namespace {

using base::Result;

// A picture depends on the frames before it: images fade in, and a few depth maps are drawn a frame. So of this many
// frames of the display before each judged one, half a second, one in kFramesPerDrawn is drawn unseen.
constexpr int kRunUpFrames = 32;

// The first second of a path belongs to the ladder, since no method shows anything at its very begin: the instants of
// means and percentiles come after it. Of a short path a quarter is enough.
constexpr double kBeginSeconds = 1.0;
constexpr double kMaxBeginShare = 0.25;

// The ladder of instants after the begin, seconds: a picture is wanted in the first of them.
constexpr double kLadder[] = {0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4};

struct Tick {
  std::size_t frame = 0;  ///< of the display
  InstantKind kind = InstantKind::kMoving;
};

double beginOf(const base::CameraPath& path) {
  return std::min(kBeginSeconds, kMaxBeginShare * path.seconds());
}

/// One instant in each of `instants` equal parts of the path after its begin, at a random place in it, and the ladder.
std::vector<Tick> ticksOf(const base::CameraPath& path, const PlayOptions& options, double interval) {
  const auto last = static_cast<std::size_t>(std::floor(path.seconds() / interval));
  const double first = std::min(beginOf(path) / interval, static_cast<double>(last));
  server::UnitRandom random(options.seed);
  std::vector<Tick> ticks;
  for (int i = 0; i < options.instants; ++i) {
    const double share = (i + random()) / options.instants;
    const double place = first + share * (static_cast<double>(last) - first);
    ticks.push_back({static_cast<std::size_t>(place), InstantKind::kMoving});
  }
  std::vector<double> ladder(std::begin(kLadder), std::end(kLadder));
  ladder.insert(ladder.end(), options.also_judged.begin(), options.also_judged.end());
  for (const double seconds : ladder)
    if (seconds < path.seconds())
      ticks.push_back({static_cast<std::size_t>(std::lround(seconds / interval)), InstantKind::kBegin});
  std::stable_sort(ticks.begin(), ticks.end(), [](const Tick& a, const Tick& b) { return a.frame < b.frame; });
  return ticks;
}

Result<base::Bytes> jpegOf(const base::Image& rgb) {
  constexpr int kPageQuality = 80;  // a choice: 20 kB a picture
  return base::encodeJpeg(rgb, kPageQuality, base::Subsampling::k420);
}

/// Plays the display's frames one after the other.
class Run {
 public:
  Run(Player& player, const base::CameraPath& path, const Truth& truth, Painter& painter, const PlayOptions& options,
      double interval, PlayedRun& run)
      : player_(player),
        path_(path),
        truth_(truth),
        painter_(painter),
        options_(options),
        interval_(interval),
        run_(run) {}

  Result<void> play() {
    const std::vector<Tick> ticks = ticksOf(path_, options_, interval_);
    const auto last = static_cast<std::size_t>(std::floor(path_.seconds() / interval_));
    std::size_t next = 0, late = 0, counted = 0;
    for (std::size_t frame = 0; frame <= last; ++frame) {
      LUMIGRID_TRY(player_.advance(timeOf(frame), path_.at(timeOf(frame))));
      if (const auto is_late = player_.isLate(); is_late && timeOf(frame) >= beginOf(path_)) {
        late += *is_late ? 1 : 0;
        run_.late_share = static_cast<double>(late) / static_cast<double>(++counted);
      }
      for (std::size_t i = next; i < ticks.size(); ++i) runUp(frame, ticks[i].frame);
      if (warm_up_) LUMIGRID_TRY(drawOnly());
      if (before_) LUMIGRID_TRY(judgeChange(frame));
      for (; next < ticks.size() && ticks[next].frame == frame; ++next) LUMIGRID_TRY(judge(frame, ticks[next].kind));
    }
    return rest(last);
  }

 private:
  double timeOf(std::size_t frame) const { return interval_ * static_cast<double>(frame); }
  void runUp(std::size_t frame, std::size_t judged) {
    const std::size_t before = judged - std::min(judged, frame);
    warm_up_ = warm_up_ || (frame < judged && before <= kRunUpFrames && before % kFramesPerDrawn == 0);
  }
  Result<void> drawOnly() {
    warm_up_ = false;
    return player_.drawUnseen();
  }
  /// Holds the last view until nothing changes any more. What comes to rest by being drawn is drawn meanwhile.
  Result<void> rest(std::size_t last) {
    const auto limit = last + static_cast<std::size_t>(options_.rest_seconds / interval_);
    std::size_t frame = last, quiet = 0;
    while (frame < limit && quiet <= kRunUpFrames) {
      ++frame;
      LUMIGRID_TRY(player_.advance(timeOf(frame), path_.frames.back()));
      quiet = player_.atRest() ? quiet + 1 : 0;
      if ((frame - last) % kFramesPerDrawn == 0) LUMIGRID_TRY(drawOnly());
    }
    run_.rest_seconds = quiet > kRunUpFrames ? timeOf(frame - quiet + 1) - timeOf(last) : -1.0;
    return judge(frame, InstantKind::kRest);
  }
  Result<void> judge(std::size_t frame, InstantKind kind) {
    const base::ViewCamera view = kind == InstantKind::kRest ? path_.frames.back() : path_.at(timeOf(frame));
    DisplayedFrame shown;
    shown.kind = kind;
    shown.seconds = timeOf(frame);
    const base::Stopwatch watch;
    LUMIGRID_ASSIGN_OR_RETURN(const auto picture, player_.draw());
    shown.draw_wall_ms = 1e3 * watch.seconds();
    shown.counts = player_.counts();
    shown.at_rest = player_.atRest();
    LUMIGRID_ASSIGN_OR_RETURN(const auto reference, truth_.picture(view, painter_));
    if (!server::showsModel(reference) && !server::showsModel(picture))
      return {};  // there is nothing to be right or wrong about
    LUMIGRID_ASSIGN_OR_RETURN(shown.accuracy, measureAccuracy(reference, picture));
    if (!options_.pictures.empty()) {
      LUMIGRID_TRY(base::makeDirectories(options_.pictures));
      const std::string name = options_.pictures + base::formatText("/%07.3f_%s", shown.seconds, nameOf(kind));
      const base::Image difference = differencePicture(reference, picture);
      LUMIGRID_TRY(base::writePng(picture, name + ".png"));
      LUMIGRID_TRY(base::writePng(difference, name + "_difference.png"));
      LUMIGRID_ASSIGN_OR_RETURN(shown.picture_jpeg, jpegOf(overMidGrey(picture)));
      LUMIGRID_ASSIGN_OR_RETURN(shown.difference_jpeg, jpegOf(difference));
    }
    run_.frames.push_back(shown);
    if (kind == InstantKind::kMoving) before_ = JudgedPicture{reference, picture};
    return {};
  }
  /// Completes the frame that was judged one earlier.
  Result<void> judgeChange(std::size_t frame) {
    const JudgedPicture before = *std::exchange(before_, std::nullopt);
    LUMIGRID_ASSIGN_OR_RETURN(auto picture, player_.draw());
    LUMIGRID_ASSIGN_OR_RETURN(auto reference, truth_.picture(path_.at(timeOf(frame)), painter_));
    const Flicker flicker = measureFlicker(before, {std::move(reference), std::move(picture)});
    for (DisplayedFrame& shown : run_.frames)
      if (shown.kind == InstantKind::kMoving && !shown.flicker) shown.flicker = flicker;
    return {};
  }

  Player& player_;
  const base::CameraPath& path_;
  const Truth& truth_;
  Painter& painter_;
  const PlayOptions& options_;
  const double interval_;
  PlayedRun& run_;
  bool warm_up_ = false;
  std::optional<JudgedPicture> before_;  // a moving frame whose change to the next one is not judged yet
};

/// Many runs' pictures at once would take gigabytes.
void keepFewPictures(PlayedRun& run) {
  std::vector<DisplayedFrame*> moving;
  for (DisplayedFrame& frame : run.frames)
    if (frame.kind == InstantKind::kMoving) moving.push_back(&frame);
  std::stable_sort(moving.begin(), moving.end(), [](const DisplayedFrame* a, const DisplayedFrame* b) {
    return a->accuracy.psnr_db < b->accuracy.psnr_db;
  });
  for (DisplayedFrame& frame : run.frames) {
    if (!moving.empty() && (&frame == moving.front() || &frame == moving[moving.size() / 2])) continue;
    frame.picture_jpeg.clear();
    frame.difference_jpeg.clear();
  }
}

double meanOf(const std::vector<const DisplayedFrame*>& frames, double (*get)(const Accuracy&)) {
  double sum = 0.0;
  for (const DisplayedFrame* frame : frames) sum += get(frame->accuracy);
  return frames.empty() ? 0.0 : sum / static_cast<double>(frames.size());
}

}  // namespace

const char* nameOf(InstantKind kind) {
  switch (kind) {
    case InstantKind::kMoving:
      return "moving";
    case InstantKind::kBegin:
      return "begin";
    case InstantKind::kRest:
      return "rest";
  }
  return "";
}

std::string fileNameOf(const std::vector<std::string>& words) {
  std::string name;
  for (const std::string& word : words) name += (name.empty() ? "" : "_") + word;
  for (char& c : name)
    if (c == '/' || c == '%') c = '-';
  return name;
}

Result<PlayedRun> playPath(const Stage& stage, const MethodSetting& setting, const NamedPath& path,
                           const LinkProfile& link, const Truth& truth, const PlayOptions& options) {
  PlayedRun run;
  run.setting = setting;
  run.path = path.name;
  run.link = link.name;
  LUMIGRID_ASSIGN_OR_RETURN(const auto player, makePlayer(stage, setting, link));
  const double frames_each = std::max(1.0, std::ceil(stage.costs.client_draw_seconds * options.display_hertz - 1e-9));
  LUMIGRID_TRY(
      Run(*player, path.path, truth, *stage.painter, options, frames_each / options.display_hertz, run).play());
  if (run.frames.empty())
    return base::Error{base::ErrorCode::kInvalidInput, "no view of the path " + path.name + " shows the model"};
  keepFewPictures(run);
  return run;
}

// ---- figures of a run ----

std::vector<const DisplayedFrame*> PlayedRun::moving() const {
  std::vector<const DisplayedFrame*> found;
  for (const DisplayedFrame& frame : frames)
    if (frame.kind == InstantKind::kMoving) found.push_back(&frame);
  return found;
}

double PlayedRun::meanPsnr() const {
  return meanOf(moving(), [](const Accuracy& a) { return a.psnr_db; });
}

double PlayedRun::meanSsim() const {
  return meanOf(moving(), [](const Accuracy& a) { return a.ssim; });
}

double PlayedRun::meanMissing() const {
  return meanOf(moving(), [](const Accuracy& a) { return a.missing_share; });
}

Flicker PlayedRun::meanFlicker() const {
  Flicker sum;
  double count = 0.0;
  for (const DisplayedFrame& frame : frames)
    if (frame.flicker) {
      sum.mean += frame.flicker->mean;
      sum.share += frame.flicker->share;
      count += 1.0;
    }
  return {sum.mean / std::max(1.0, count), sum.share / std::max(1.0, count)};
}

double PlayedRun::silhouette() const {
  return meanOf(moving(), [](const Accuracy& a) { return a.silhouette_px; });
}

double PlayedRun::p95Silhouette() const {
  return meanOf(moving(), [](const Accuracy& a) { return a.silhouette_p95_px; });
}

double PlayedRun::p5Psnr() const {
  std::vector<double> psnr;
  for (const DisplayedFrame* frame : moving()) psnr.push_back(frame->accuracy.psnr_db);
  if (psnr.empty()) return 0.0;
  std::sort(psnr.begin(), psnr.end());
  return psnr[static_cast<std::size_t>(0.05 * static_cast<double>(psnr.size()))];
}

double PlayedRun::secondsTo(double psnr_db) const {
  double since = -1.0;
  for (const DisplayedFrame& frame : frames) {
    const bool good = frame.accuracy.psnr_db >= psnr_db;
    if (!good) since = -1.0;
    if (good && since < 0.0) since = frame.seconds;
  }
  return since;
}

double PlayedRun::secondsToFirst() const {
  for (const DisplayedFrame& frame : frames)
    if (frame.accuracy.missing_share < 0.5) return frame.seconds;
  return -1.0;
}

}  // namespace compare
