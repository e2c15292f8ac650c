#pragma once
// The tree of sampling points beside the parameters in a store's meta text (docs/formats/repository.md).
#include <optional>
#include <string>

#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"

namespace repository {

/// `parameters` (a JSON object, one parameter a line) with the tree as one more line.
std::string withTree(const std::string& parameters, const SampleTree& tree);
/// The text without that line.
std::string withoutTree(const std::string& text);
/// The tree that the text holds, or nothing where the whole grid is sampled. `name` is the store's, for the error.
base::Result<std::optional<SampleTree>> treeFromText(const std::string& text, const Grid& grid,
                                                     const std::string& name);

}  // namespace repository
