#pragma once
// The hull of a scene without patches, which its first view fits in.
#include <string>

#include "base/error.h"
#include "base/json/scene_file.h"

namespace server::cli {

/// Stores the hull of a coarse cut of the scene's hlod.lgh, else of its qsplat.lgq, else of its pmr.lgm; none where it
/// lists none of them. It takes a tenth of a second. `directory`: the scene's. Errors name the file: those of opening
/// it, and kInvalidInput where what is read of it is damaged.
base::Result<void> setStreamedHull(const std::string& directory, base::Scene& scene);

}  // namespace server::cli
