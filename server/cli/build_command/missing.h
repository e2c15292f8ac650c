#pragma once
// `lumigrid build --missing` lists what the same command would still have to make.
#include "base/error.h"
#include "server/cli/build_command/options.h"
#include "server/cli/scene_images.h"

namespace server::cli {

/// Cheap, so that it can be asked often: sources are known by their sizes, images by their keys.
base::Result<MissingParts> findMissingParts(const BuildArguments& a);

}  // namespace server::cli
