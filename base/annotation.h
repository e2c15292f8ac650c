#pragma once
// Notes that belong to a place on the surface (docs/formats/annotations.md), and the checks that every reader makes.
// base/json/annotations_file reads their JSON, and in a browser the page does.
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <string>
#include <vector>

#include "base/camera.h"
#include "base/error.h"

namespace base {

inline constexpr const char* kAnnotationsFile = "annotations.json";
inline constexpr std::size_t kMaxAnnotationsBytes = std::size_t{16} << 20;  ///< length of the file
inline constexpr std::size_t kMaxAnnotations = 500;
inline constexpr std::size_t kMaxAnnotationTitle = 200;    ///< bytes of UTF-8
inline constexpr std::size_t kMaxAnnotationText = 10'000;  ///< bytes of UTF-8
inline constexpr int kAnnotationsVersion = 1;

struct Annotation {
  glm::dvec3 position{0.0};          ///< world, on the surface
  glm::dvec3 normal{0.0};            ///< away from the surface, unit; zero: unknown
  std::string title;                 ///< plain text, one line; never empty
  std::string text;                  ///< plain text, may have line breaks and be empty
  std::optional<ViewCamera> camera;  ///< the best place to look at it from; width and height mean nothing
};

/// Normalises normal and direction and checks everything else: finite numbers within 10^12, lengths, UTF-8, no control
/// characters but line breaks and tabs in the text. Errors name the wrong member.
Result<Annotation> checkedAnnotation(Annotation annotation);

}  // namespace base
