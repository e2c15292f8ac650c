#pragma once
// Reads annotations.json (docs/formats/annotations.md), for native viewers, and for servers and publishers, which check
// the text and hand it on unchanged.
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "base/annotation.h"
#include "base/bytes.h"
#include "base/error.h"

namespace base {

/// The notes, checked. An error begins with `name` and names the note and the member: kInvalidInput, kVersion.
Result<std::vector<Annotation>> parseAnnotations(ByteView text, const std::string& name);

/// The text of an annotations.json that was checked, and how many notes it has.
struct AnnotationsText {
  std::string text;
  std::size_t notes = 0;
};
/// Reads and checks directory/annotations.json; nullopt where there is no such file.
Result<std::optional<AnnotationsText>> readAnnotations(const std::string& directory);

}  // namespace base
