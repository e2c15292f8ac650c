#pragma once
// JSON that comes from outside: what the server answers to a pick, and annotations.json. Hostile bytes: checked, named
// one-line errors.
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "client/annotation.h"
#include "client/measure.h"

namespace client {

inline constexpr std::size_t kMaxPickAnswer = 4096;                   ///< bytes
inline constexpr std::size_t kMaxAnnotationsFile = 16 * 1024 * 1024;  ///< bytes

/// The path and query that ask where a ray meets the surface (docs/formats/http.md, /pick). World coordinates.
std::string pickTarget(const glm::dvec3& origin, const glm::dvec3& direction);
base::Result<PickAnswer> parsePickAnswer(base::ByteView text);
/// docs/formats/annotations.md. `name` begins the error's line.
base::Result<std::vector<Annotation>> parseAnnotations(base::ByteView text, const std::string& name);

}  // namespace client
