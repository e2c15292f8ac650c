#pragma once
// The first view of a scene as `lumigrid set --start-view` takes it.
#include <string>
#include <string_view>

#include "base/error.h"

namespace server::cli {

/// Whether a viewer takes the text for a permalink of version 1 (docs/formats/permalink.md): each part is known, stands
/// once, and lies within its limits.
bool isPermalink(std::string_view text);

/// The permalink in `text`, which is one, an address that ends in one, or the name of a file with either. kInvalidInput
/// where there is none.
base::Result<std::string> permalinkIn(const std::string& text);

}  // namespace server::cli
