#pragma once
// The first view of a scene as a build finds it, and as `lumigrid set --start-view` takes it.
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "lod/patch/orientation.h"

namespace server::cli {

/// Whether a viewer takes the text for a permalink of version 1 (docs/formats/permalink.md): each part is known, stands
/// once, and lies within its limits.
bool isPermalink(std::string_view text);

/// Whether a scene's `start_view` is as setFirstView() stores it: a cut, or nothing.
bool isOwnView(std::string_view link);

/// Stores where the first view looks, what it fits in, and where an interior is cut open. A first view that somebody
/// chose stays, unless it is no more than a cut.
void setFirstView(const lod::patch::Orientation& found, base::Scene& scene);
/// The latter alone. `hull`: scene-local, at most lod::patch::kMaxHullPoints.
void setHull(const std::vector<glm::vec3>& hull, base::Scene& scene);

/// The permalink in `text`, which is one, an address that ends in one, or the name of a file with either. kInvalidInput
/// where there is none.
base::Result<std::string> permalinkIn(const std::string& text);

}  // namespace server::cli
