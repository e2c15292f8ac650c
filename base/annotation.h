#pragma once
// Notes that belong to a place on the surface (docs/formats/annotations.md): what may be in them, for whoever reads
// them. JSON is read by base/json/annotations_file, in a browser by the page.
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <string>
#include <vector>

#include "base/camera.h"
#include "base/error.h"

namespace base {

inline constexpr const char* kAnnotationsFile = "annotations.json";
inline constexpr std::size_t kMaxAnnotationsBytes = std::size_t{16} << 20;  ///< of the file
inline constexpr std::size_t kMaxAnnotations = 500;
inline constexpr std::size_t kMaxAnnotationTitle = 200;    ///< bytes of UTF-8
inline constexpr std::size_t kMaxAnnotationText = 10'000;  ///< bytes of UTF-8
inline constexpr int kAnnotationsVersion = 1;

struct Annotation {
  glm::dvec3 position{0.0};          ///< world, on the surface
  glm::dvec3 normal{0.0};            ///< away from the surface, unit; zero: not said
  std::string title;                 ///< plain text, one line; never empty
  std::string text;                  ///< plain text, may have line breaks and be empty
  std::optional<ViewCamera> camera;  ///< the best place to look at it from; width and height mean nothing
};

/// Makes normal and direction unit and checks all else: finite numbers within 10^12, lengths, UTF-8, no control
/// characters but line breaks and tabs in the text. Errors name what is wrong.
Result<Annotation> checkedAnnotation(Annotation annotation);

}  // namespace base
