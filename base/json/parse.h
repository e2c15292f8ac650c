#pragma once
// Reads JSON texts. The parser takes two seconds to compile, so it is compiled here alone.
#include <nlohmann/json.hpp>

#include "base/bytes.h"

namespace base {

/// Returns a discarded value for a text that is no JSON in UTF-8, or that nests deeper than 16 objects and lists:
/// deeper than any document of ours. nlohmann's parser keeps a stack, so that hostile nesting would cost memory.
nlohmann::json parseJson(ByteView text);

}  // namespace base
