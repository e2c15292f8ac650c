#pragma once
// The viewer's behaviour, once for the browser's page and the native window: what mouse, fingers and keys do, which
// modes there are, when to draw, and what stands on top of the picture. No window, DOM, JSON, thread or clock here; the
// platform brings events and the time, draws the words, and carries out requests.
//
// A platform's loop, each turn (an animation frame, or when events came):
//   hand events over (pointerDown … setHidden) and messages to session();
//   app.advance(now);
//   if (app.wantsFrame()) app.frame(now);             // into the framebuffer bound now; then show it
//   for (Request& request : app.takeRequests()) …;   // carry out
//   draw the overlay when overlayVersion() changed: labels(), toasts(), status(), progress(), help, open annotation;
//   statistics about four times a second while view().statistics.
//
// Controls are listed by helpRows() in client/input.h. All calls come from one thread, the one of the GL context. `now`
// is seconds from any zero and never runs backwards.
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/annotation.h"
#include "base/error.h"
#include "client/app/input.h"
#include "client/app/label.h"
#include "client/app/measure.h"
#include "client/app/settings.h"
#include "client/app/view_state.h"
#include "client/viewer/decode.h"
#include "client/viewer/statistics.h"
#include "client/viewer/viewer.h"

namespace client {

using base::Annotation;
using base::kMaxAnnotations;

struct AppOptions {
  ViewerOptions viewer;
  Settings settings;  ///< must be valid (setSetting); the viewer's limits are taken from here unless the platform sets
                      ///< them after
  bool apply_settings =
      true;  ///< false: `viewer` is used as it is (a command line that says all), settings for the rest
  /// Seconds, finer than `now`, to time drawing with. Empty: frame_milliseconds stays 0.
  std::function<double()> clock;
  /// The world point shown at (x, y) of a view, nullopt over background. Empty: Viewer::surfaceAt, which needs GL. When
  /// given, nothing of GL is asked between frames, and no pin counts as behind the surface.
  std::function<std::optional<glm::dvec3>(const base::ViewCamera&, double x, double y)> surface;
};

// ---- what the platform must do ----

enum class RequestKind : std::uint8_t {
  kCopyLink,     ///< V: `text` is the permalink without '#'; put the page's address (or nothing) in front, and copy it
  kLinkChanged,  ///< the view has come to rest: `text` is its permalink (a browser replaces the hash, no history entry)
  kSavePicture,  ///< P: a picture of the view; ask the server for it, with `text` as the query of /render but for size
                 ///< and background (pictureQuery), or read the framebuffer
  kKeepBookmarks,  ///< bookmark(1 … 9) changed: keep them with the scene
  kKeepSettings,   ///< settings() changed: keep them
  kShowSettings,   ///< G: show settings() to be changed
  kPick,  ///< find the full-resolution surface on the ray `origin` + t `direction`, t ≥ 0; answerPick(`id`, …)
};

struct Request {
  RequestKind kind = RequestKind::kCopyLink;
  std::string text;
  std::uint32_t id = 0;
  glm::dvec3 origin{0.0};     ///< world
  glm::dvec3 direction{0.0};  ///< unit, world
  base::ViewCamera camera;    ///< kSavePicture: its size on the screen
};

// ---- what stands on top of the picture ----

struct Toast {
  std::uint32_t id = 0;
  std::string text;    ///< one line
  bool error = false;  ///< to be announced at once; stays longer
};

/// The connection and the scene in plain words.
struct Status {
  enum class Kind : std::uint8_t { kConnecting, kLoading, kReady, kLost, kRefused };
  Kind kind = Kind::kConnecting;
  std::string text;    ///< what is wrong, one line; empty when nothing is
  std::string advice;  ///< what happens now or what to do; may be empty
};

/// A discreet bar.
struct Progress {
  bool active = false;
  double share = 0.0;  ///< 0 … 1, never runs backwards while active
};

enum class Mode : std::uint8_t { kLook, kDistance, kAngle };

inline constexpr int kBookmarks = 10;

class App {
 public:
  App(const AppOptions& options, std::unique_ptr<ImageDecoder> decoder);
  ~App();
  App(const App&) = delete;
  App& operator=(const App&) = delete;

  /// For the transport: connected(), receive(), nextToSend(). Also for a static source of data.
  Session& session();
  Viewer& viewer();

  // ---- events ----

  /// Framebuffer pixels, and how many of them a screen unit has (window.devicePixelRatio), for what has the size of a
  /// finger. A size of 0 is taken as hidden.
  void resize(int width_px, int height_px, double pixel_ratio);
  void pointerDown(const PointerEvent& event);
  void pointerMove(const PointerEvent& event);  ///< of pointers that are not down, too
  void pointerUp(const PointerEvent& event);
  void pointerCancel(int id);  ///< the system took the pointer away: as if it had never been clicked
  /// Steps of a mouse wheel, above 0 nearer; fractions for touchpads.
  void wheel(double steps, double x, double y, double now);
  /// Down again and again while held is fine. True when the key means something here, so that a page keeps the browser
  /// from acting on it.
  bool key(Key key, bool down, Modifiers modifiers, double now);
  void blur();                  ///< the view lost the keyboard: all keys and pointers are up
  void setHidden(bool hidden);  ///< nothing is drawn or moved while hidden
  /// The GL context is gone: nothing is drawn until contextRestored(), called with a new one current. Both as the
  /// viewer has them.
  void contextLost();
  base::Result<void> contextRestored();
  void setReducedMotion(bool system_wants);  ///< what the system says; settings can overrule it

  // ---- the loop ----

  /// Motion, toasts that go, answers about pins. The GL context must be current.
  void advance(double now);
  /// Whether another picture would differ from the last one drawn. At rest it is false.
  bool wantsFrame() const;
  /// Advances and draws. Errors are the viewer's: GL out of order.
  base::Result<void> frame(double now);

  // ---- requests and their answers ----

  std::vector<Request> takeRequests();
  void answerPick(std::uint32_t id, const PickAnswer& answer);
  /// Something that the platform has to tell: "picture saved as …", "cannot write …".
  void showToast(std::string text, bool error = false);

  // ---- state that comes from outside and goes there ----

  const ViewState& view() const;
  std::string permalink() const;
  void showStatistics(bool shown);
  bool lensShown() const;  ///< the magnifying glass
  /// The picture's colour where there is no model: RGBA, 0 … 1.
  void setBackground(const std::array<float, 4>& color);
  /// Goes to a link's view at once; before the scene is known it becomes the first view. An error changes nothing and
  /// is shown as a toast, too.
  base::Result<void> openPermalink(std::string_view text);
  const std::string& bookmark(int slot) const;  ///< 1 … 9: its permalink, or empty; 0 is always empty
  base::Result<void> setBookmark(int slot, std::string_view permalink);  ///< from storage; empty: none
  const Settings& settings() const;
  /// By name (settingFields()); takes effect at once where it can, and asks for kKeepSettings.
  base::Result<void> changeSetting(std::string_view name, double value);
  /// Replaces all; those over kMaxAnnotations are left out with a toast.
  void setAnnotations(std::vector<Annotation> annotations);
  const std::vector<Annotation>& annotations() const;

  // ---- the overlay ----

  /// Counts up whenever something below may have changed, statistics excepted.
  std::uint64_t overlayVersion() const;
  const std::vector<Label>& labels() const;     ///< as of the last advance() or frame()
  const std::vector<LabelLine>& lines() const;  ///< likewise
  const std::vector<Toast>& toasts() const;     ///< oldest first, at most 3
  Status status() const;
  Progress progress() const;
  Mode mode() const;
  std::string modeHint() const;  ///< what to do in this mode, one line; empty in kLook
  bool helpShown() const;
  void showHelp(bool shown);
  std::optional<std::size_t> openAnnotation() const;  ///< whose card is shown
  /// Shows a pin's card and flies to its camera when it has one; nullopt closes the card.
  void showAnnotation(std::optional<std::size_t> index);
  const std::vector<Measurement>& measurements() const;
  const std::string& unit() const;  ///< of the scene's lengths; empty when not known
  std::string sceneName() const;    ///< empty before the scene is known
  base::ViewCamera camera() const;  ///< as drawn now
  Statistics statistics() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace client
