#pragma once
// A store records all that decides the bytes of its faces, so that faces of different builds never mix
// (docs/formats/repository.md, "Parameters").
#include <string>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "repository/store.h"
#include "server/bake/bake.h"

namespace server {

/// The parameters as JSON with one of them a line, so that a difference can be told by its line; with the tree of
/// options.points as the last line where only some points are sampled.
std::string storeParameters(const base::Scene& scene, const BakeOptions& options);

/// Writes the parameters to a new store. kExists, with the first line that differs, where the store has others.
base::Result<void> claimStore(repository::Store& store, const std::string& parameters);

}  // namespace server
