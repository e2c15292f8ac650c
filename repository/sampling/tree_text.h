#pragma once
// The tree of sampling points beside the parameters in a store's meta text (docs/formats/repository.md).
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"

namespace repository {

/// How the repository stood when all cells of one size had been judged.
struct TreeGrowth {
  std::uint32_t cell = 0;       ///< grid steps along an edge of the cells judged
  std::uint64_t cells = 0;      ///< leaves of the tree then
  std::uint64_t points = 0;     ///< with images
  std::uint64_t bytes = 0;      ///< of all values
  double psnr_db = 99.0;        ///< of the held-out views in this round's cells, all pixels together
  double worst_psnr_db = 99.0;  ///< of the worst cell's
  std::uint64_t split = 0;      ///< of the cells judged
};

/// `parameters` (a JSON object, one parameter a line) with the tree and its growth as two more lines.
std::string withTree(const std::string& parameters, const SampleTree& tree, const std::vector<TreeGrowth>& growth);
/// The text without them.
std::string withoutTree(const std::string& text);
/// The tree that the text holds, or nothing where the whole grid is sampled. `name` is the store's, for the error.
base::Result<std::optional<SampleTree>> treeFromText(const std::string& text, const Grid& grid,
                                                     const std::string& name);
std::vector<TreeGrowth> growthFromText(const std::string& text);

}  // namespace repository
