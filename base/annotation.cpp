#include "base/annotation.h"

#include <cmath>
#include <glm/gtc/constants.hpp>
#include <string_view>

namespace base {
namespace {

Error bad(const std::string& problem) {
  return {ErrorCode::kInvalidInput, problem + " (docs/formats/annotations.md)"};
}

bool isPlace(const glm::dvec3& v) {
  for (int i = 0; i < 3; ++i)
    if (!(std::abs(v[i]) <= kMaxCoordinate)) return false;
  return true;
}

/// The number of bytes of the UTF-8 sequence at the front; 0 for an invalid one (overlong, cut, surrogate, too large).
std::size_t sequenceLength(std::string_view text) {
  const auto at = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char first = at(0);
  if (first < 0x80) return 1;
  const std::size_t length = first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : 2;
  if (first < 0xC2 || first > 0xF4 || text.size() < length) return 0;
  for (std::size_t i = 1; i < length; ++i)
    if ((at(i) & 0xC0U) != 0x80U) return 0;
  const unsigned char second = at(1);
  if ((first == 0xE0 && second < 0xA0) || (first == 0xED && second > 0x9F)) return 0;
  if ((first == 0xF0 && second < 0x90) || (first == 0xF4 && second > 0x8F)) return 0;
  return length;
}

/// Whether the text is UTF-8 without control characters, except those in `allowed`.
bool isPlainText(std::string_view text, std::string_view allowed) {
  while (!text.empty()) {
    const std::size_t length = sequenceLength(text);
    if (length == 0) return false;
    const auto first = static_cast<unsigned char>(text.front());
    if ((first < 0x20 || first == 0x7F) && allowed.find(text.front()) == std::string_view::npos) return false;
    text.remove_prefix(length);
  }
  return true;
}

Result<void> checkCamera(ViewCamera& camera) {
  if (!isPlace(camera.position)) return bad("camera: position must lie within 1e12");
  const double length = glm::length(camera.direction);
  if (!isPlace(camera.direction) || !(length > 1e-12)) return bad("camera: direction must not be zero");
  camera.direction /= length;
  if (!(camera.fov_y >= kMinFov && camera.fov_y <= glm::pi<double>() - kMinFov))
    return bad("camera: the field of view must lie between 0 and 180 degrees");
  return {};
}

}  // namespace

Result<Annotation> checkedAnnotation(Annotation annotation) {
  if (!isPlace(annotation.position)) return bad("position must be three numbers within 1e12");
  if (!isPlace(annotation.normal)) return bad("normal must be three numbers within 1e12");
  const double length = glm::length(annotation.normal);
  annotation.normal = length > 1e-12 ? annotation.normal / length : glm::dvec3(0.0);

  if (annotation.title.empty() || annotation.title.size() > kMaxAnnotationTitle)
    return bad("title must have 1 to " + std::to_string(kMaxAnnotationTitle) + " bytes");
  if (!isPlainText(annotation.title, "")) return bad("title must be one line of UTF-8");
  if (annotation.text.size() > kMaxAnnotationText)
    return bad("text must have at most " + std::to_string(kMaxAnnotationText) + " bytes");
  if (!isPlainText(annotation.text, "\n\t")) return bad("text must be UTF-8 without control characters");

  if (annotation.camera) LUMIGRID_TRY(checkCamera(*annotation.camera));
  return annotation;
}

}  // namespace base
