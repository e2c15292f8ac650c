#pragma once
// The first view of a scene as a build finds it, and as `lumigrid set --start-view` takes it.
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "lod/patch/orientation.h"

namespace server {
class Indoors;
}

namespace server::cli {

/// Whether a viewer takes the text for a permalink of version 1 (docs/formats/permalink.md): each part is known, stands
/// once, and lies within its limits.
bool isPermalink(std::string_view text);

/// Whether a scene's `start_view` is as setFirstView() stores it without rooms: a cut, or nothing.
bool isOwnView(std::string_view link);

/// The recorded option by which a scan is looked at from within; scenes that record none leave it open.
inline constexpr const char* kInteriorParameter = "interior";
lod::patch::InteriorChoice interiorChoiceOf(const base::Scene& scene);

/// The link to the place in an interior with the widest view, towards where one sees farthest.
std::string linkInto(const Indoors& rooms, const base::Scene& scene);

/// Stores where the first view looks, what it fits in, and where an interior is cut open, or, where no cut opens it,
/// the view from its rooms. A first view that somebody chose stays, unless it is no more than a cut. `rooms`: null
/// where there are none.
void setFirstView(const lod::patch::Orientation& found, const Indoors* rooms, base::Scene& scene);
/// The latter alone. `hull`: scene-local, at most lod::patch::kMaxHullPoints.
void setHull(const std::vector<glm::vec3>& hull, base::Scene& scene);

/// The permalink in `text`, which is one, an address that ends in one, or the name of a file with either. kInvalidInput
/// where there is none.
base::Result<std::string> permalinkIn(const std::string& text);

}  // namespace server::cli
