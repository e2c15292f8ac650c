#pragma once
// Recognizes gestures in pointer events: orbit, pan, pinch, click, double click. It knows no camera.
#include <cstdint>
#include <vector>

#include "client/app/input.h"

namespace client {

enum class GestureKind : std::uint8_t {
  kOrbit,        ///< by (dx, dy) pixels
  kGrab,         ///< takes hold of the point at (x, y); kPan follows
  kPan,          ///< moves the grabbed point to (x, y)
  kPinch,        ///< magnifies by `factor` around (x, y); above 1 comes nearer
  kClick,        ///< down and up at the same place
  kDoubleClick,  ///< the second of two clicks, in place of kClick
};

struct Gesture {
  GestureKind kind = GestureKind::kClick;
  double x = 0.0, y = 0.0;    ///< pixels from the upper left corner
  double dx = 0.0, dy = 0.0;  ///< kOrbit
  double factor = 1.0;        ///< kPinch
  PointerKind pointer = PointerKind::kMouse;
};

/// A drag begins when a pointer leaves the small circle in which it may tremble, so nothing jumps. One finger orbits;
/// two fingers pan and pinch at once; further fingers are ignored; the finger that is left of two starts a new gesture.
/// A long press has no effect.
class GestureReader {
 public:
  void setPixelRatio(double ratio) { ratio_ = ratio; }
  void down(const PointerEvent& event);
  std::vector<Gesture> move(const PointerEvent& event);
  std::vector<Gesture> up(const PointerEvent& event);
  void cancel(int id);
  void cancelAll() { pointers_.clear(); }
  bool anyDown() const { return !pointers_.empty(); }

 private:
  struct Pointer {
    PointerEvent first;  // the event that began the drag or click
    double x, y;         // now
    bool dragging = false;
    bool clickable = true;
  };
  Pointer* find(int id);
  double slop(PointerKind kind) const;
  void beginPair();
  std::vector<Gesture> movePair();

  std::vector<Pointer> pointers_;  // in the order in which they came down
  double ratio_ = 1.0;
  bool pair_grabbed_ = false;
  double pair_distance_ = 0.0;
  double last_click_ = -1e9;
  double last_click_x_ = 0.0, last_click_y_ = 0.0;
};

}  // namespace client
