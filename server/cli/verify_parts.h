#pragma once
// What `lumigrid verify` looks at in a scene on the disk and in a published one behind a network alike.
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/json/scene_file.h"
#include "repository/packs/pack_store.h"
#include "repository/sampling/parameters.h"
#include "repository/store.h"

namespace server::cli {

/// A line for each thing that is wrong.
using Faults = std::vector<std::string>;

/// Told how much of the images is read, 0..1; returns false to stop.
using VerifyProgress = std::function<bool(double done)>;

/// A patch hierarchy on the disk: all that PatchFile::verify finds, and what does not go with scene.json.
void verifyPatches(const std::string& path, const base::Scene& scene, Faults& faults);

/// The same of splats.
void verifySplats(const std::string& path, const base::Scene& scene, Faults& faults);

/// The points that a store samples; nothing, and a fault, when it does not say. `path`: of the store, for messages.
std::optional<repository::SampledPoints> samplesOf(const repository::Store& store, const std::string& path,
                                                   Faults& faults);

/// Published images. `path`: of their index, for messages.
void verifyPacks(const repository::PackStore& packs, const std::string& path, const VerifyProgress& progress,
                 Faults& faults);

}  // namespace server::cli
