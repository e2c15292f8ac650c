#pragma once
// annotations.json: notes at places of the surface (docs/formats/annotations.md). Servers and publishers hand it on as
// it is; what is checked here is that viewers will take it.
#include <cstddef>
#include <optional>
#include <string>

#include "base/bytes.h"
#include "base/error.h"

namespace base {

inline constexpr const char* kAnnotationsFile = "annotations.json";
inline constexpr std::size_t kMaxAnnotationsBytes = std::size_t{16} << 20;

/// How many notes the text holds. The error's line begins with `name` and names the note and the member: kInvalidInput,
/// kVersion.
Result<std::size_t> checkAnnotations(ByteView text, const std::string& name);

/// directory/annotations.json, checked; nothing where there is no such file.
struct AnnotationsText {
  std::string text;
  std::size_t notes = 0;
};
Result<std::optional<AnnotationsText>> readAnnotations(const std::string& directory);

}  // namespace base
