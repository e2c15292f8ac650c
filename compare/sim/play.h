#pragma once
// Plays one method along one path over one link, in virtual time, and judges what the display shows: at seeded instants
// while the path lasts, at a ladder of instants after the begin, and at rest after its end. Every judged picture is
// compared with the truth of the view at that very instant.
#include <optional>
#include <string>
#include <vector>

#include "base/camera_path.h"
#include "compare/accuracy.h"
#include "compare/sim/player.h"

namespace compare {

struct NamedPath {
  std::string name;
  base::CameraPath path;  ///< with times
};

struct PlayOptions {
  int instants = 12;                ///< judged while the path lasts
  std::vector<double> also_judged;  ///< seconds after the begin, beside the ladder
  double display_hertz = 60.0;
  double rest_seconds = 30.0;  ///< longest wait after the path's end
  std::uint32_t seed = 1;
  std::string pictures;  ///< folder for the judged pictures and their differences; empty: none are written
};

enum class InstantKind { kMoving, kBegin, kRest };
const char* nameOf(InstantKind kind);

/// The display at one judged instant.
struct DisplayedFrame {
  InstantKind kind = InstantKind::kMoving;
  double seconds = 0.0;  ///< since the client began to connect
  double draw_wall_ms = 0.0;
  PlayerCounts counts;
  bool at_rest = false;
  Accuracy accuracy;
  std::optional<Flicker> flicker;             ///< to the display's next frame (measureFlicker); of moving frames alone
  base::Bytes picture_jpeg, difference_jpeg;  ///< for the page: of a run's worst and median moving frames alone
};

struct PlayedRun {
  std::string scene, link, path;
  MethodSetting setting;
  std::vector<DisplayedFrame> frames;  ///< in the order of time
  double rest_seconds = 0.0;  ///< from the path's end until nothing changed any more; < 0: not within the limit

  double late_share = -1.0;   ///< of the display's frames behind the path's begin: Player::isLate(); < 0: not known

  std::vector<const DisplayedFrame*> moving() const;
  double meanPsnr() const;
  double p5Psnr() const;  ///< 5th percentile: the worst of twelve
  double meanSsim() const;
  double meanMissing() const;
  Flicker meanFlicker() const;
  double silhouette() const;     ///< mean over frames of the silhouettes' mean distance, pixels
  double p95Silhouette() const;  ///< mean over frames of the 95th percentiles
  /// The first judged instant whose picture, and every later one, has this PSNR; < 0: never.
  double secondsTo(double psnr_db) const;
  double secondsToFirst() const;  ///< the first judged picture that shows anything
};

/// The words joined by underscores, without what file names cannot have.
std::string fileNameOf(const std::vector<std::string>& words);

base::Result<PlayedRun> playPath(const Stage& stage, const MethodSetting& setting, const NamedPath& path,
                                 const LinkProfile& link, const Truth& truth, const PlayOptions& options);

}  // namespace compare
