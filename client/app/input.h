#pragma once
// Input events and keys that do not depend on the platform: GLFW's and the browser's events are translated to these.
#include <cstdint>
#include <span>
#include <string_view>

namespace client {

enum class PointerKind : std::uint8_t { kMouse, kTouch, kPen };
enum class PointerButton : std::uint8_t { kLeft, kMiddle, kRight };

struct Modifiers {
  bool shift = false;
  bool ctrl = false;  ///< the command key of a Mac counts as ctrl
  bool alt = false;
};

/// A mouse has one id; each finger and pen has its own from down to up.
struct PointerEvent {
  int id = 0;
  PointerKind kind = PointerKind::kMouse;
  PointerButton button = PointerButton::kLeft;  ///< for down and up; meaningless while moving
  Modifiers modifiers;
  double x = 0.0, y = 0.0;  ///< framebuffer pixels (device pixels) from the upper left corner of the view
  double now = 0.0;         ///< seconds from any zero; never decreases
};

enum class Key : std::uint8_t {
  kNone,  ///< a key without a meaning here
  // clang-format off
  // Keys that fly go by their place on the keyboard.
  kW, kA, kS, kD, kQ, kE, kUp, kDown, kLeft, kRight,
  // All others go by the letter that is printed on them.
  kF, kR, kHome, kI, kC, kM, kN, kX, kO, kP, kV, kH, kG, kL, kEscape, kEnter,
  kBackspace,         ///< also Delete
  kPageUp, kPageDown, ///< also the full stop and the comma
  kShift,             ///< flies faster while it is down
  kPlus, kMinus,
  k0, k1, k2, k3, k4, k5, k6, k7, k8, k9,
  // clang-format on
};

/// Returns the key for a browser's KeyboardEvent `code` ("KeyW", "Digit3", "Numpad3", "ArrowUp": the place) and `key`
/// ("w", "F", "?": the character). Letters with a meaning go by their character; flying keys and digits go by place, so
/// that WASD is a cross on every layout and shift changes no digit; signs come last. kNone for all others.
Key keyFromNames(std::string_view code, std::string_view key);

/// One row of the help panel: an input and its effect, in plain English.
struct HelpRow {
  std::string_view input;   ///< "left drag", "W A S D"
  std::string_view effect;  ///< "turn around the pivot"
};
std::span<const HelpRow> helpRows();

}  // namespace client
