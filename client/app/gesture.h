#pragma once
// Pointers that go down, move and up become gestures: orbit, pan, pinch, click, double click. No camera here.
#include <cstdint>
#include <vector>

#include "client/app/input.h"

namespace client {

enum class GestureKind : std::uint8_t {
  kOrbit,        ///< by (dx, dy) pixels
  kGrab,         ///< takes hold at (x, y); kPan follows
  kPan,          ///< what was grabbed goes to (x, y)
  kPinch,        ///< magnify `factor` times around (x, y), above 1 nearer
  kClick,        ///< down and up at one place
  kDoubleClick,  ///< the second of two clicks, in place of kClick
};

struct Gesture {
  GestureKind kind = GestureKind::kClick;
  double x = 0.0, y = 0.0;    ///< pixels from the upper left corner
  double dx = 0.0, dy = 0.0;  ///< kOrbit
  double factor = 1.0;        ///< kPinch
  PointerKind pointer = PointerKind::kMouse;
};

/// A drag begins where a pointer leaves the small circle in which it may tremble, so nothing jumps. One finger orbits;
/// two pan and pinch at once; further ones are not looked at; what stays of two begins anew. A long press is nothing.
class GestureReader {
 public:
  void setPixelRatio(double ratio) { ratio_ = ratio; }
  void down(const PointerEvent& event);
  std::vector<Gesture> move(const PointerEvent& event);
  std::vector<Gesture> up(const PointerEvent& event);
  void cancel(int id);
  void cancelAll();
  bool anyDown() const { return !pointers_.empty(); }

 private:
  struct Pointer {
    PointerEvent first;  // where a drag or click began
    double x, y;         // now
    bool dragging = false;
    bool clickable = true;
  };
  Pointer* find(int id);
  double slop(PointerKind kind) const;
  void beginPair();
  std::vector<Gesture> movePair();
  void dropPointer(int id);

  std::vector<Pointer> pointers_;  // in the order in which they came down
  double ratio_ = 1.0;
  bool pair_grabbed_ = false;
  double pair_distance_ = 0.0;
  double last_click_ = -1e9;
  double last_click_x_ = 0.0, last_click_y_ = 0.0;
};

}  // namespace client
