#pragma once
// What a store's meta text says (docs/formats/repository.md, "Parameters").
#include <cstdint>
#include <optional>
#include <string>

#include "base/error.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"

namespace repository {

/// The grid that a store's meta text records, as server::bake writes it:
/// {"grid": {"first": [x, y, z], "spacing": s, "count": [nx, ny, nz], "face_size": pixels}, …}. `name` is the store's,
/// for the error.
base::Result<Grid> gridFromMeta(const std::string& meta, const std::string& name);

/// The same with the tree that the text may hold (tree_text.h).
base::Result<SampledPoints> sampledPointsFromMeta(const std::string& meta, const std::string& name);

/// Whether two meta texts record the same parameters. What they say of trees is not looked at: those grow.
bool sameParameters(const std::string& stored, const std::string& wanted);
/// In what they differ, by the first line that does: "quality": 85, now "quality": 90.
std::string firstDifference(const std::string& stored, const std::string& wanted);

}  // namespace repository
