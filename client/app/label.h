#pragma once
// What is written and drawn over the picture, in its pixels. The platform draws it.
#include <cstdint>
#include <string>

namespace client {

enum class LabelKind : std::uint8_t {
  kPin,            ///< annotation `index`: a pin with its title; showAnnotation(index) or a click at it opens it
  kPoint,          ///< a measured point
  kValue,          ///< a measured value: `text`
  kSectionHandle,  ///< drags the section plane along its axis
};

struct Label {
  LabelKind kind = LabelKind::kPin;
  std::uint32_t index = 0;   ///< of its kind; the same thing keeps its index
  double x = 0.0, y = 0.0;   ///< framebuffer pixels from the upper left corner
  bool visible = false;      ///< in the picture and not behind the surface
  bool approximate = false;  ///< kPoint, kValue: the exact answer is not here yet, or there is none
  bool open = false;         ///< kPin: its card is shown
  std::string text;          ///< plain text, not escaped
};

/// A line between two measured points, cut at the eye's plane, or a piece of the magnifying glass's rim. Framebuffer
/// pixels.
struct LabelLine {
  double x0 = 0.0, y0 = 0.0, x1 = 0.0, y1 = 0.0;
  bool approximate = false;
};

}  // namespace client
