#pragma once
// Orders in which the blocks of a view are fetched (Rusinkiewicz and Levoy 2001, sections 4.2 and 4.3).
#include <array>
#include <optional>
#include <string_view>
#include <utility>

#include "lod/qsplat/traverse.h"

namespace lod::qsplat {

/// The five orders of the paper.
enum class StreamOrder {
  kLevel,    ///< 1: by level in the tree
  kRadius,   ///< 2: by radius in the scene, largest first
  kSize,     ///< 3: by size on the screen, largest first
  kTopDown,  ///< 4: from the screen's top to its bottom, whatever the size
  kSweeps,   ///< 5: sweepPriority, the paper's choice
};
inline constexpr std::array<std::pair<StreamOrder, std::string_view>, 5> kStreamOrderNames{
    {{StreamOrder::kLevel, "level"},
     {StreamOrder::kRadius, "radius"},
     {StreamOrder::kSize, "size"},
     {StreamOrder::kTopDown, "rows"},
     {StreamOrder::kSweeps, "sweeps"}}};
std::optional<StreamOrder> streamOrderFromName(std::string_view name);

/// The order's priority. Blocks that are seen through the lens come before all others.
Priority priorityFor(StreamOrder order, const std::optional<Lens>& lens, int picture_height);

}  // namespace lod::qsplat
