#pragma once
// annotations.json (docs/formats/annotations.md): the one reader of its JSON, for servers and publishers, which hand
// the text on as it is, and for native viewers.
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "base/annotation.h"
#include "base/bytes.h"
#include "base/error.h"

namespace base {

/// Its notes, checked. The error's line begins with `name` and names the note and the member: kInvalidInput, kVersion.
Result<std::vector<Annotation>> parseAnnotations(ByteView text, const std::string& name);

/// directory/annotations.json, checked; nothing where there is no such file.
struct AnnotationsText {
  std::string text;
  std::size_t notes = 0;
};
Result<std::optional<AnnotationsText>> readAnnotations(const std::string& directory);

}  // namespace base
