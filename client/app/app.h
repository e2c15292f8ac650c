#pragma once
// The viewer's behaviour, shared by the browser's page and the native window: the effects of mouse, fingers and keys,
// the modes, when to draw, and the overlay. It has no window, DOM, JSON, thread or clock: the platform brings events
// and the time, draws the overlay, and carries out requests.
//
// A platform's loop, each turn (an animation frame, or when events came):
//   hand events over (pointerDown … setHidden) and messages to session();
//   app.advance(now);
//   if (app.wantsFrame()) app.drawFrame(now);             // into the framebuffer bound now; then show it
//   for (Request& request : app.takeRequests()) …;   // carry out
//   draw the overlay when overlayVersion() changed: labels(), toasts(), status(), progress(), help, open annotation;
//   statistics about four times a second while view().statistics.
//
// helpRows() in client/app/input.h lists the controls. All calls come from one thread, the one of the GL context. `now`
// is seconds from any zero and never decreases.
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
  Settings settings;  ///< must be valid (setSetting)
  /// Takes the viewer's limits from `settings`. False: `viewer` is used as it is, since a command line has set it.
  bool apply_settings = true;
  /// Returns seconds, finer than `now`, to time drawing with. Empty: frame_milliseconds stays 0.
  std::function<double()> clock;
  /// Returns the world point shown at (x, y) of a view, nullopt over background. Empty: Viewer::surfaceAt, which needs
  /// GL. When it is given, no GL function is called between frames, and no pin counts as hidden by the surface.
  std::function<std::optional<glm::dvec3>(const base::ViewCamera&, double x, double y)> surface;
};

// ---- requests to the platform ----

enum class RequestKind : std::uint8_t {
  /// V was pressed. `text` is the permalink without '#'; put the page's address (or nothing) in front, and copy it.
  kCopyLink,
  /// The view has come to rest. `text` is its permalink; a browser replaces the hash, without a history entry.
  kLinkChanged,
  /// P was pressed. Ask the server for the picture, with `text` as the query of /render except for size and background
  /// (pictureQuery), or read the framebuffer.
  kSavePicture,
  kKeepBookmarks,  ///< bookmark(1 … 9) changed: store them with the scene
  kKeepSettings,   ///< settings() changed: store them
  kShowSettings,   ///< G was pressed: let the user edit settings()
  /// Find the full-resolution surface on the ray `origin` + t `direction`, t ≥ 0, and call answerPick(`id`, …).
  kPick,
};

struct Request {
  RequestKind kind = RequestKind::kCopyLink;
  std::string text = {};
  std::uint32_t id = 0;
  glm::dvec3 origin{0.0};        ///< world
  glm::dvec3 direction{0.0};     ///< unit, world
  base::ViewCamera camera = {};  ///< kSavePicture: the view, in its size on the screen
};

// ---- the overlay's contents ----

struct Toast {
  std::uint32_t id = 0;
  std::string text;    ///< one line
  bool error = false;  ///< announced at once, and shown longer
};

/// The connection and the scene in plain words.
struct Status {
  enum class Kind : std::uint8_t { kConnecting, kLoading, kReady, kLost, kRefused };
  Kind kind = Kind::kConnecting;
  std::string text;    ///< the problem, one line; empty when there is none
  std::string advice;  ///< what happens now, or what to do; may be empty
};

/// The progress bar.
struct Progress {
  bool active = false;
  double share = 0.0;  ///< 0 … 1, never decreases while active
};

enum class Mode : std::uint8_t { kLook, kDistance, kAngle };

inline constexpr int kBookmarks = 10;

class App {
 public:
  App(const AppOptions& options, std::unique_ptr<ImageDecoder> decoder);
  ~App();
  App(const App&) = delete;
  App& operator=(const App&) = delete;

  /// For the transport, which calls connected(), receive() and nextToSend(), and for a StaticSource.
  Session& session();
  Viewer& viewer();

  // ---- events ----

  /// Sets the size in framebuffer pixels, and the number of pixels for each screen unit (window.devicePixelRatio),
  /// which scales everything that must fit a finger. A size of 0 counts as hidden.
  void resize(int width_px, int height_px, double pixel_ratio);
  void pointerDown(const PointerEvent& event);
  void pointerMove(const PointerEvent& event);  ///< also for pointers that are not down
  void pointerUp(const PointerEvent& event);
  void pointerCancel(int id);  ///< the system took the pointer away; it does not count as a click
  /// Turns the mouse wheel by `steps`, positive to come nearer; touchpads send fractions.
  void turnWheel(double steps, double x, double y, double now);
  /// Presses or releases a key; repeated presses while it is held are ignored. Returns true when the key has an effect
  /// here, so that a page keeps the browser from acting on it.
  bool handleKey(Key key, bool down, Modifiers modifiers, double now);
  void blur();                  ///< the view lost the keyboard: all keys and pointers count as released
  void setHidden(bool hidden);  ///< nothing is drawn or moved while hidden
  /// The GL context is lost: nothing is drawn until contextRestored(), which is called with a new one current.
  void contextLost();
  base::Result<void> contextRestored();
  void setReducedMotion(bool system_wants);  ///< the system's preference; settings can overrule it

  // ---- the loop ----

  /// Advances motion, removes old toasts, and reads answers about pins. The GL context must be current.
  void advance(double now);
  /// Whether another picture would differ from the last one drawn. False at rest.
  bool wantsFrame() const;
  /// Advances and draws. Errors come from the viewer: GL does not work.
  base::Result<void> drawFrame(double now);

  // ---- requests and their answers ----

  std::vector<Request> takeRequests();
  void answerPick(std::uint32_t id, const PickAnswer& answer);
  /// Shows a message of the platform: "picture saved as …", "cannot write …".
  void showToast(std::string text, bool error = false);

  // ---- state that comes from outside and goes there ----

  const ViewState& view() const;
  std::string permalink() const;
  void showStatistics(bool shown);
  bool lensShown() const;  ///< whether the magnifying glass is shown
  /// Sets the picture's colour where there is no model: RGBA, 0 … 1.
  void setBackground(const std::array<float, 4>& color);
  /// Goes to a link's view at once; before the scene is known it becomes the first view. A link with an error changes
  /// nothing, and a toast says what is wrong.
  base::Result<void> openPermalink(std::string_view text);
  const std::string& bookmark(int slot) const;  ///< 1 … 9: the slot's permalink, or empty; slot 0 is always empty
  base::Result<void> setBookmark(int slot,
                                 std::string_view permalink);  ///< restores one from storage; empty removes it
  const Settings& settings() const;
  /// Changes a setting by name (settingFields()). Takes effect at once where it can, and requests kKeepSettings.
  base::Result<void> changeSetting(std::string_view name, double value);
  /// Replaces all annotations. Those beyond kMaxAnnotations are left out, and a toast says so.
  void setAnnotations(std::vector<Annotation> annotations);
  const std::vector<Annotation>& annotations() const;

  // ---- the overlay ----

  /// Counts up whenever something below may have changed, statistics excepted.
  std::uint64_t overlayVersion() const;
  const std::vector<Label>& labels() const;     ///< as of the last advance() or drawFrame()
  const std::vector<LabelLine>& lines() const;  ///< likewise
  const std::vector<Toast>& toasts() const;     ///< oldest first, at most 3
  Status status() const;
  Progress progress() const;
  Mode mode() const;
  std::string modeHint() const;  ///< how to use this mode, one line; empty in kLook
  bool helpShown() const;
  void showHelp(bool shown);
  std::optional<std::size_t> openAnnotation() const;  ///< the annotation whose card is shown
  /// Shows a pin's card and flies to its camera when it has one; nullopt closes the card.
  void showAnnotation(std::optional<std::size_t> index);
  const std::vector<Measurement>& measurements() const;
  const std::string& unit() const;  ///< unit of the scene's lengths; empty when not known
  std::string sceneName() const;    ///< empty before the scene is known
  base::ViewCamera camera() const;  ///< the camera that is drawn now
  Statistics statistics() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace client
