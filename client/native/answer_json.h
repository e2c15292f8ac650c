#pragma once
// Reads a server's answer to a pick. The bytes come from outside: they are checked, and errors are one line each.
#include <string>

#include "base/bytes.h"
#include "base/error.h"
#include "client/app/measure.h"

namespace client {

inline constexpr std::size_t kMaxPickAnswer = 4096;  ///< bytes

/// Returns the path and query that ask where a ray meets the surface (docs/formats/http.md, /pick). World coordinates.
std::string pickTarget(const glm::dvec3& origin, const glm::dvec3& direction);
base::Result<PickAnswer> parsePickAnswer(base::ByteView text);

}  // namespace client
