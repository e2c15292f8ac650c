#pragma once
// Writes and reads the tree of sampling points in a store's meta text, beside the parameters
// (docs/formats/repository.md, "Tree of sampling points").
#include <optional>
#include <string>

#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"

namespace repository {

/// Adds the tree as one more line to `parameters`, a JSON object with one parameter a line.
std::string withTree(const std::string& parameters, const SampleTree& tree);
/// Removes that line.
std::string withoutTree(const std::string& text);
/// The tree that the text holds; nothing where the whole grid is sampled. Errors name the store by `name`.
base::Result<std::optional<SampleTree>> treeFromText(const std::string& text, const Grid& grid,
                                                     const std::string& name);

}  // namespace repository
