#pragma once
// What a store's meta text says (docs/formats/repository.md, "Parameters").
#include <string>

#include "base/error.h"
#include "repository/grid.h"

namespace repository {

/// The grid that a store's meta text records, as server::bake writes it:
/// {"grid": {"first": [x, y, z], "spacing": s, "count": [nx, ny, nz], "face_size": pixels}, …}. `name` is the store's,
/// for the error.
base::Result<Grid> gridFromMeta(const std::string& meta, const std::string& name);

/// In what two meta texts differ, by their first line that does: "quality": 85, now "quality": 90.
std::string firstDifference(const std::string& stored, const std::string& wanted);

}  // namespace repository
