#pragma once
// Notes that belong to a place on the surface (docs/formats/annotations.md). Reading them is the platform's: JSON by
// nlohmann natively, by the page in a browser; what may be in them is checked here.
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <string>
#include <vector>

#include "base/camera.h"
#include "base/error.h"

namespace client {

inline constexpr std::size_t kMaxAnnotations = 1000;
inline constexpr std::size_t kMaxAnnotationTitle = 200;    ///< bytes of UTF-8
inline constexpr std::size_t kMaxAnnotationText = 10'000;  ///< bytes of UTF-8
inline constexpr int kAnnotationsVersion = 1;

struct Annotation {
  glm::dvec3 position{0.0};                ///< world, on the surface
  glm::dvec3 normal{0.0};                  ///< away from the surface, unit; zero: not said
  std::string title;                       ///< plain text, one line; never empty
  std::string text;                        ///< plain text, may have line breaks and be empty
  std::optional<base::ViewCamera> camera;  ///< the best place to look at it from; width and height mean nothing
};

/// Makes normal and direction unit and checks all else: finite numbers within 10^12, lengths, UTF-8, no control
/// characters but line breaks and tabs in the text. Errors name what is wrong.
base::Result<Annotation> checkedAnnotation(Annotation annotation);

}  // namespace client
