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
#include <utility>
#include <vector>

#include "base/annotation.h"
#include "base/error.h"
#include "client/app/flight.h"
#include "client/app/gesture.h"
#include "client/app/input.h"
#include "client/app/measure.h"
#include "client/app/meters.h"
#include "client/app/orbit_control.h"
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
  Settings settings;                                       ///< must be valid (setSetting)
  OwnLight light;                                          ///< at the start
  lod::hlod::Shadows shadows = lod::hlod::Shadows::kNone;  ///< at the start; those of `settings` with apply_settings
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

// ---- the overlay's contents: labels and lines over the picture, in its pixels, which the platform draws ----

enum class LabelKind : std::uint8_t {
  kPin,            ///< the pin of annotation `index`; a click opens it (showAnnotation)
  kPoint,          ///< a measured point
  kValue,          ///< a measured value, as `text`
  kSectionHandle,  ///< drags the section plane along its axis
};

struct Label {
  LabelKind kind = LabelKind::kPin;
  std::uint32_t index = 0;   ///< number within its kind; stable for the same item
  double x = 0.0, y = 0.0;   ///< framebuffer pixels from the upper left corner
  bool visible = false;      ///< in the picture and not behind the surface
  bool approximate = false;  ///< kPoint, kValue: there is no exact answer (yet)
  bool open = false;         ///< kPin: its card is shown
  std::string text;          ///< plain text, not escaped
};

/// A line between two measured points, clipped at the eye's plane, or a segment of the magnifying glass's rim.
/// Framebuffer pixels.
struct LabelLine {
  double x0 = 0.0, y0 = 0.0, x1 = 0.0, y1 = 0.0;
  bool approximate = false;
};

struct Toast {
  std::uint32_t id = 0;
  std::string text;    ///< one line
  bool error = false;  ///< announced at once, and shown longer
  double until = 0.0;  ///< seconds, the time at which it goes
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
  App(const App&) = delete;
  App& operator=(const App&) = delete;

  /// For the transport, which calls connected(), receive() and nextToSend(), and for a StaticSource.
  Session& session() { return viewer_.session(); }
  Viewer& viewer() { return viewer_; }

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
  void contextLost() { viewer_.contextLost(); }
  base::Result<void> contextRestored();
  /// Sets the system's preference, which the settings can overrule.
  void setReducedMotion(bool system_wants) { system_reduces_motion_ = system_wants; }

  // ---- the loop ----

  /// Advances motion, removes old toasts, and reads answers about pins. The GL context must be current.
  void advance(double now);
  /// Whether another picture would differ from the last one drawn. False at rest.
  bool wantsFrame() const;
  /// Advances and draws. Errors come from the viewer: GL does not work.
  base::Result<void> drawFrame(double now);

  // ---- requests and their answers ----

  std::vector<Request> takeRequests() { return std::exchange(requests_, {}); }
  void answerPick(std::uint32_t id, const PickAnswer& answer);
  /// Shows a message of the platform: "picture saved as …", "cannot write …".
  void showToast(std::string text, bool error = false);

  // ---- state that comes from outside and goes there ----

  const ViewState& view() const { return view_; }
  std::string permalink() const;
  void showStatistics(bool shown);
  bool lensShown() const { return lens_.has_value(); }  ///< whether the magnifying glass is shown
  /// Sets the picture's colour where there is no model: RGBA, 0 … 1.
  void setBackground(const std::array<float, 4>& color);
  /// Goes to a link's view at once; before the scene is known it becomes the first view. A link with an error changes
  /// nothing, and a toast says what is wrong.
  base::Result<void> openPermalink(std::string_view text);
  const std::string& bookmark(int slot) const;  ///< 1 … 9: the slot's permalink, or empty; slot 0 is always empty
  base::Result<void> setBookmark(int slot,
                                 std::string_view permalink);  ///< restores one from storage; empty removes it
  const Settings& settings() const { return settings_; }
  /// Changes a setting by name (settingFields()). Takes effect at once where it can, and requests kKeepSettings.
  base::Result<void> changeSetting(std::string_view name, double value);
  /// Replaces all annotations. Those beyond kMaxAnnotations are left out, and a toast says so.
  void setAnnotations(std::vector<Annotation> annotations);
  const std::vector<Annotation>& annotations() const { return annotations_; }

  // ---- the overlay ----

  /// Counts up whenever something below may have changed, statistics excepted.
  std::uint64_t overlayVersion() const { return overlay_version_; }
  /// Labels and lines are as of the last advance() or drawFrame().
  const std::vector<Label>& labels() const { return labels_; }
  const std::vector<LabelLine>& lines() const { return lines_; }
  const std::vector<Toast>& toasts() const { return toasts_; }  ///< oldest first, at most 3
  Status status() const;
  Progress progress() const { return progress_; }
  Mode mode() const { return mode_; }
  std::string modeHint() const;  ///< how to use this mode, one line; empty in kLook
  bool helpShown() const { return help_; }
  void showHelp(bool shown);
  /// The annotation whose card is shown.
  std::optional<std::size_t> openAnnotation() const { return open_annotation_; }
  /// Shows a pin's card and flies to its camera when it has one; nullopt closes the card.
  void showAnnotation(std::optional<std::size_t> index);
  const std::vector<Measurement>& measurements() const { return measure_.all(); }
  const std::string& unit() const;  ///< unit of the scene's lengths; empty when not known
  /// Empty before the scene is known.
  std::string sceneName() const { return framed_ ? framed_->scene_name : ""; }
  /// Whom the scene names as the scan's authors, to be shown with its name; mostly empty.
  std::string attribution() const { return framed_ ? framed_->attribution : ""; }
  /// The scene's own colour where there is no model.
  std::optional<base::Rgb> sceneBackground() const { return framed_ ? framed_->background : std::nullopt; }
  /// Where north is in the present view, as on a compass: radians clockwise from straight ahead. Nothing when the scene
  /// does not know its north.
  std::optional<double> northTurn() const;
  base::ViewCamera camera() const;  ///< the camera that is drawn now
  Statistics statistics() const;

 private:
  bool ready() const { return framed_.has_value(); }
  bool drawable() const { return width_ > 0 && height_ > 0 && !hidden_; }
  bool reducedMotion() const {
    const auto choice = static_cast<ReducedMotion>(static_cast<int>(settings_.reduced_motion));
    return choice == ReducedMotion::kOn || (choice == ReducedMotion::kSystem && system_reduces_motion_);
  }
  void configureViewer();
  std::optional<glm::dvec3> surfaceAt(double x, double y);
  double pickRadius(PointerKind kind) const;

  // Changes.
  void overlayChanged();
  void cameraMoved();
  void frameNewScene();
  void fly(double seconds);
  bool flying() const;
  void moveTo(const Viewpoint& place, bool glide);
  void showView(const ViewState& wanted, bool whole, bool glide);

  // Gestures.
  void applyGesture(const Gesture& gesture);
  void handleClick(const Gesture& gesture);
  void setPivotAt(double x, double y);
  std::optional<std::size_t> pinAt(double x, double y, PointerKind kind) const;
  void zoom(double steps, double x, double y);

  // Modes.
  void cycleMeasure();
  void setMode(Mode wanted);
  void measureAt(double x, double y);
  void cycleSection();
  void turnOnSection(int axis);
  void moveSection(double distance);
  int sectionAxis(int place) const;
  bool hiddenBySection(const glm::dvec3& world) const;
  Ray pickRay(double x, double y) const;
  glm::dvec3 sectionHandle() const;
  bool grabHandle(const PointerEvent& event);
  void dragHandle(const PointerEvent& event);
  void setShadows(lod::hlod::Shadows shadows);
  void toggleLight();
  glm::dvec2 lightHandle() const;
  bool grabLight(const PointerEvent& event);
  void dragLight(double x, double y);
  double lensRadius() const;
  void toggleLens();
  bool grabLens(const PointerEvent& event);
  void dragLens(const PointerEvent& event);
  void stepAnnotation(int by);
  bool closeInnermost();
  void useBookmark(int slot, bool store);
  bool pressKey(Key key, Modifiers modifiers);

  // The overlay.
  void refreshOverlay();
  void addPins();
  void addMeasurements();
  void addLens();
  void addLight();
  void addLine(const glm::dvec3& a, const glm::dvec3& b, bool approximate);
  Label labelAt(LabelKind kind, std::size_t index, const glm::dvec3& world) const;
  void readPinAnswers();
  bool pinHidden(std::size_t index) const;
  void updateProgress();
  void expireToasts();
  bool atRest() const;
  void reportRest();
  void updateMeters();

  AppOptions options_;
  Settings settings_;
  Viewer viewer_;
  OrbitControl control_;
  GestureReader gestures_;
  Flight flight_;
  ViewState view_;  // its camera fields are as of the last change

  // The scene.
  std::optional<protocol::Welcome> framed_;  // the Welcome for which the first view was chosen
  std::optional<ViewState> wanted_view_;     // a link that was opened before the scene was known

  // The surface into which the client draws.
  int width_ = 0, height_ = 0;
  double pixel_ratio_ = 1.0;
  bool hidden_ = false;
  bool system_reduces_motion_ = false;

  // Keys and pointers.
  std::array<bool, 256> held_{};
  bool shift_ = false;
  bool turning_ = false;     // ctrl was down when an arrow was pressed
  int handle_pointer_ = -1;  // the pointer that drags the section's handle; −1: none
  glm::dvec2 handle_at_{0.0};
  std::optional<glm::dvec2> lens_;  // centre of the magnifying glass, framebuffer pixels
  int lens_pointer_ = -1;           // the pointer that drags it; −1: none
  int light_pointer_ = -1;          // the pointer that drags the light's handle; −1: none
  struct WheelTarget {
    double at = -1e9, x = 0.0, y = 0.0;
    std::optional<glm::dvec3> surface;
  } wheel_target_;

  // Time.
  double now_ = 0.0, last_motion_ = 0.0;
  bool started_ = false;  // `now_` is valid
  double draw_seconds_ = 0.0;
  RateMeter frame_rate_, byte_rate_;
  RoundTripMeter round_trip_;
  std::uint64_t seen_bytes_ = 0;
  double images_used_ = 0.0, images_came_ = 0.0;  // for the hit rate
  std::uint64_t seen_images_ = 0;

  // The state of the last picture.
  bool dirty_ = true;
  bool moved_since_frame_ = true;
  bool frame_moved_ = false;  // the last picture was of a moving view
  double frame_at_ = 0.0;     // its time
  std::uint64_t drawn_messages_ = 0;

  // The overlay.
  std::uint64_t overlay_version_ = 1;
  bool overlay_dirty_ = true;
  Status last_status_;
  Progress progress_;
  double incomplete_since_ = -1.0;
  float first_error_ = 0.0F;
  std::vector<Toast> toasts_;
  std::uint32_t next_toast_ = 1;
  bool help_ = false;
  std::vector<Label> labels_;
  std::vector<LabelLine> lines_;

  // Modes.
  Mode mode_ = Mode::kLook;
  MeasureTool measure_;
  std::uint32_t next_pick_ = 1;
  std::vector<Annotation> annotations_;
  std::vector<bool> pins_visible_;
  bool pins_changed_ = false;  // the viewer has not been told yet
  std::optional<std::size_t> open_annotation_;

  std::array<std::string, kBookmarks> bookmarks_;
  std::string last_link_;
  std::vector<Request> requests_;
};

}  // namespace client
