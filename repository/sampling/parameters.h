#pragma once
// Reads the parameters that a store records in its meta text (docs/formats/repository.md, "Parameters").
#include <cstdint>
#include <optional>
#include <string>

#include "base/error.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"

namespace repository {

/// The grid that a meta text records, as server::bake writes it:
/// {"grid": {"first": [x, y, z], "spacing": s, "count": [nx, ny, nz], "face_size": pixels}, …}. Errors name the store
/// by `name`.
base::Result<Grid> gridFromMeta(const std::string& meta, const std::string& name);

/// The grid together with the tree that the text may hold (tree_text.h).
base::Result<SampledPoints> sampledPointsFromMeta(const std::string& meta, const std::string& name);

/// The first line in which two meta texts differ: "quality": 85, now "quality": 90. For texts that differ only in their
/// trees it is "other sampling points".
std::string firstDifference(const std::string& stored, const std::string& wanted);

}  // namespace repository
