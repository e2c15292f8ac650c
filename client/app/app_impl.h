#pragma once
// The members and private functions of client::App: the view and its motion (app_view.cpp), gestures, keys and modes
// (app_tools.cpp), the overlay (app_overlay.cpp), and the public functions (app.cpp). Only these four files include it.
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/app/app.h"
#include "client/app/flight.h"
#include "client/app/gesture.h"
#include "client/app/meters.h"
#include "client/app/orbit_control.h"

namespace client {

struct App::Impl {
  Impl(const AppOptions& wanted, std::unique_ptr<ImageDecoder> decoder);

  AppOptions options;
  Settings settings;
  Viewer viewer;
  OrbitControl control;
  GestureReader gestures;
  Flight flight;
  ViewState view;  // its camera fields are as of the last change

  // The scene.
  std::optional<protocol::Welcome> framed;  // the Welcome for which the first view was chosen
  std::optional<ViewState> wanted_view;     // a link that was opened before the scene was known
  glm::dvec3 box_min{0.0}, box_max{0.0};    // world

  // The surface into which the client draws.
  int width = 0, height = 0;
  double pixel_ratio = 1.0;
  bool hidden = false;
  bool system_reduces_motion = false;

  // Keys and pointers.
  std::array<bool, 256> held{};
  bool shift = false;
  bool turning = false;     // ctrl was down when an arrow was pressed
  int handle_pointer = -1;  // the pointer that drags the section's handle; −1: none
  glm::dvec2 handle_at{0.0};
  std::optional<glm::dvec2> lens;  // centre of the magnifying glass, framebuffer pixels
  int lens_pointer = -1;           // the pointer that drags it; −1: none
  struct WheelTarget {
    double at = -1e9, x = 0.0, y = 0.0;
    std::optional<glm::dvec3> surface;
  } wheel_target;

  // Time.
  double now = 0.0, last_motion = 0.0;
  bool started = false;  // `now` is valid
  double draw_seconds = 0.0;
  RateMeter frame_rate, byte_rate;
  RoundTripMeter round_trip;
  std::uint64_t seen_bytes = 0;
  double images_used = 0.0, images_came = 0.0;  // for the hit rate
  std::uint64_t seen_images = 0;

  // The state of the last picture.
  bool dirty = true;
  bool moved_since_frame = true;
  std::uint64_t drawn_messages = 0;

  // The overlay.
  std::uint64_t overlay_version = 1;
  bool overlay_dirty = true;
  Status last_status;
  Progress progress;
  double incomplete_since = -1.0;
  float first_error = 0.0F;
  std::vector<Toast> toasts;
  std::vector<double> toast_ends;
  std::uint32_t next_toast = 1;
  bool help = false;
  std::vector<Label> labels;
  std::vector<LabelLine> lines;

  // Modes.
  Mode mode = Mode::kLook;
  MeasureTool measure;
  std::uint32_t next_pick = 1;
  std::vector<Annotation> annotations;
  std::vector<bool> pins_visible;
  bool pins_changed = false;  // the viewer has not been told yet
  std::optional<std::size_t> open_annotation;

  std::array<std::string, kBookmarks> bookmarks;
  std::string last_link;
  std::vector<Request> requests;

  // Queries.
  bool ready() const { return framed.has_value(); }
  bool drawable() const { return width > 0 && height > 0 && !hidden; }
  bool reducedMotion() const {
    const auto choice = static_cast<ReducedMotion>(static_cast<int>(settings.reduced_motion));
    return choice == ReducedMotion::kOn || (choice == ReducedMotion::kSystem && system_reduces_motion);
  }
  base::ViewCamera drawnCamera() const;
  void configureViewer();
  std::optional<glm::dvec3> surfaceAt(double x, double y);
  double pickRadius(PointerKind kind) const;

  // Changes.
  void overlayChanged();
  void cameraMoved();
  void showToast(std::string text, bool error);
  void frameNewScene();
  void fly(double seconds);
  bool flying() const;
  void moveTo(const Viewpoint& place, bool glide);
  void showView(const ViewState& wanted, bool whole, bool glide);
  void advanceTo(double time);

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
  double lensRadius() const;
  void toggleLens();
  bool grabLens(const PointerEvent& event);
  void dragLens(const PointerEvent& event);
  void stepAnnotation(int by);
  void openCard(std::optional<std::size_t> index);
  bool closeInnermost();
  void useBookmark(int slot, bool store);
  bool pressKey(Key key, Modifiers modifiers);

  // The overlay.
  void refreshOverlay();
  void addPins();
  void addMeasurements();
  void addLens();
  void addLine(const glm::dvec3& a, const glm::dvec3& b, bool approximate);
  Label labelAt(LabelKind kind, std::size_t index, const glm::dvec3& world) const;
  void readPinAnswers();
  bool pinHidden(std::size_t index) const;
  void updateProgress();
  void expireToasts();
  void reportRest();
  void updateMeters();
  Status status() const;
};

}  // namespace client
