#include "base/annotation.h"

#include <cmath>
#include <glm/gtc/constants.hpp>

#include "base/text.h"

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
  if (!isPlainText(annotation.title)) return bad("title must be one line of UTF-8");
  if (annotation.text.size() > kMaxAnnotationText)
    return bad("text must have at most " + std::to_string(kMaxAnnotationText) + " bytes");
  if (!isPlainText(annotation.text, "\n\t")) return bad("text must be UTF-8 without control characters");

  if (annotation.camera) LUMIGRID_TRY(checkCamera(*annotation.camera));
  return annotation;
}

}  // namespace base
