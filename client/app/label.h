#pragma once
// Labels and lines over the picture, in its pixels. The platform draws them.
#include <cstdint>
#include <string>

namespace client {

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

}  // namespace client
