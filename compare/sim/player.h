#pragma once
// A method in virtual time: server, link and client in one process, without a clock. compare::playPath() tells it what
// time it is and what the viewer looks at, and now and then asks for the picture that the display shows.
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/image.h"
#include "compare/painter.h"
#include "compare/sim/link.h"
#include "lod/hlod/shadow_options.h"
#include "server/scene/open_scene.h"

namespace compare {

class PublishedObjects;

/// Durations of work in virtual time. The defaults are choices (docs/formats/comparison.md, "Costs").
struct Costs {
  double server_render_seconds = 0.020;  ///< a frame of the view's size, drawn and encoded
  double client_decode_seconds = 0.004;  ///< a JPEG of 512 × 512, or as many pixels
  double client_draw_seconds = 0.010;    ///< a frame; longer than a display's interval: frames are shown less often
};

/// Counts of a player since it began.
struct PlayerCounts {
  std::uint64_t bytes = 0;  ///< on the link towards the client, without headers of TCP and IP
  std::uint64_t bytes_images = 0, bytes_patches = 0, bytes_frames = 0;
  std::uint64_t requests = 0;     ///< messages or requests that the client sent
  std::uint64_t cache_bytes = 0;  ///< compressed data that the client holds
  std::uint64_t triangles = 0;    ///< in the last picture; splats, or points and triangles
  std::uint32_t images = 0;       ///< blended in the last picture
  double age_seconds = 0.0;       ///< how old the view is that the last picture shows; 0 for methods that draw here
};

/// Drawing is what costs here, so one frame in so many of the display is drawn, and counts for all of them.
inline constexpr int kFramesPerDrawn = 4;

class Player {
 public:
  virtual ~Player() = default;
  /// Lets everything happen that is due by `now`, seconds since the client began to connect, and then shows `camera`.
  /// `now` never decreases. One call for each frame of the display.
  virtual base::Result<void> advance(double now, const base::ViewCamera& camera) = 0;
  /// Draws what the display shows after the last advance(). RGBA, alpha is coverage.
  virtual base::Result<base::Image> draw() = 0;
  /// Draws as draw() does, for a picture that nobody judges: what the next one depends on.
  virtual base::Result<void> drawUnseen() { return {}; }
  /// Whether nothing changes any more while the view stays.
  virtual bool atRest() const = 0;
  /// Whether the view lacks parts of a file that the method streams; nothing of methods without one.
  virtual std::optional<bool> isLate() const { return std::nullopt; }
  virtual PlayerCounts counts() const = 0;
};

/// The surroundings that all players of a scene share. A GL context is current.
struct Stage {
  const server::OpenScene* scene = nullptr;
  Painter* painter = nullptr;
  std::function<base::Result<const PublishedObjects*>()> published;  ///< publishes the scene when it is first asked for
  Costs costs;
  std::uint32_t seed = 1;
  std::optional<std::uint64_t> idle_bytes;  ///< client::StreamedOptions::idle_bytes; nothing: the viewers' own
};

/// A method with one setting of its knob.
struct MethodSetting {
  std::string method;
  double knob = 0.0;
};

/// The variant of hlod that has such shadows: "hlod-hard", which is no name of methodNames().
std::string hlodWith(lod::hlod::Shadows shadows);
/// The shadows of a method's pictures, by which it is judged.
lod::hlod::Shadows shadowsOf(const std::string& method);

/// The methods that there are, in the order of the report.
const std::vector<std::string>& methodNames();
/// Those of them that the scene has data for.
std::vector<std::string> methodsFor(const server::OpenScene& scene);
/// The knob's default, and the values of a sweep, the default among them.
std::vector<double> knobsOf(const std::string& method, bool sweep);
/// The meaning of the knob, as a chart's legend says it: "pixels of the patches' error".
std::string knobName(const std::string& method);

base::Result<std::unique_ptr<Player>> makePlayer(const Stage& stage, const MethodSetting& setting,
                                                 const LinkProfile& link);

// ---- one file each, but for the three of streamed files
base::Result<std::unique_ptr<Player>> makeSessionPlayer(const Stage& stage, const MethodSetting& setting,
                                                        const LinkProfile& link);
base::Result<std::unique_ptr<Player>> makeSplatsPlayer(const Stage& stage, const MethodSetting& setting,
                                                       const LinkProfile& link);
base::Result<std::unique_ptr<Player>> makeUmbrellasPlayer(const Stage& stage, const MethodSetting& setting,
                                                          const LinkProfile& link);
base::Result<std::unique_ptr<Player>> makeHlodPlayer(const Stage& stage, const MethodSetting& setting,
                                                     const LinkProfile& link);
base::Result<std::unique_ptr<Player>> makeStaticPlayer(const Stage& stage, const MethodSetting& setting,
                                                       const LinkProfile& link);
base::Result<std::unique_ptr<Player>> makeFramesPlayer(const Stage& stage, const MethodSetting& setting,
                                                       const LinkProfile& link);
base::Result<std::unique_ptr<Player>> makeVideoPlayer(const Stage& stage, const MethodSetting& setting,
                                                      const LinkProfile& link);

}  // namespace compare
