#pragma once
// In which order a view's blocks come (Rusinkiewicz and Levoy 2001, sections 4.2 and 4.3).
#include <array>
#include <optional>
#include <string_view>
#include <utility>

#include "lod/qsplat/traverse.h"

namespace lod::qsplat {

/// The paper's five.
enum class StreamOrder {
  kLevel,    ///< 1: by level in the tree
  kRadius,   ///< 2: the largest spheres of the scene
  kSize,     ///< 3: the largest on the screen
  kTopDown,  ///< 4: from the screen's top to its bottom, whatever their size
  kSweeps,   ///< 5: sweepPriority, the paper's choice
};
inline constexpr std::array<std::pair<StreamOrder, std::string_view>, 5> kStreamOrderNames{
    {{StreamOrder::kLevel, "level"},
     {StreamOrder::kRadius, "radius"},
     {StreamOrder::kSize, "size"},
     {StreamOrder::kTopDown, "rows"},
     {StreamOrder::kSweeps, "sweeps"}}};
std::optional<StreamOrder> streamOrderFromName(std::string_view name);

/// What is seen through the lens comes before all else.
Priority priorityFor(StreamOrder order, const std::optional<Lens>& lens, int picture_height);

}  // namespace lod::qsplat
