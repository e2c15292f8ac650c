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

/// Whether two meta texts record the same parameters. The tree of sampling points is no parameter and is ignored.
bool sameParameters(const std::string& stored, const std::string& wanted);
/// The first line in which two texts differ: "quality": 85, now "quality": 90.
std::string firstDifference(const std::string& stored, const std::string& wanted);

}  // namespace repository
