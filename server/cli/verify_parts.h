#pragma once
// The checks of `lumigrid verify` that a scene on the disk and a published one behind a network share.
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "repository/packs/pack_store.h"

namespace server::cli {

/// A line for each thing that is wrong.
using Faults = std::vector<std::string>;

/// The value; where there is an error, nothing, and its message among the faults.
template <class T>
std::optional<T> valueOrFault(base::Result<T> result, Faults& faults) {
  if (result) return std::move(*result);
  faults.push_back(result.error().message);
  return std::nullopt;
}

/// Called with the share of the images that is read, 0..1; returns false to stop.
using VerifyProgress = std::function<bool(double done)>;

/// Checks a patch hierarchy on the disk: all that PatchFile::verify finds, and that it agrees with scene.json.
void verifyPatches(const std::string& path, const base::Scene& scene, Faults& faults);

/// Checks a tree of splats on the disk in the same way.
void verifySplats(const std::string& path, const base::Scene& scene, Faults& faults);

/// Checks published images. `path`: of their index, for messages.
void verifyPacks(const repository::PackStore& packs, const std::string& path, const VerifyProgress& progress,
                 Faults& faults);

}  // namespace server::cli
