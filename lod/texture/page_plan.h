#pragma once
// Decides which charts go to which pages, at which place and which scale. Private to lod/texture.
#include <glm/glm.hpp>

#include <cstdint>
#include <vector>

#include "lod/texture/charts.h"
#include "lod/texture/page.h"

namespace lod::texture {

/// The part of a page that belongs to one chart: its rectangle, and the gutter around it.
struct Slot {
  std::uint32_t chart = 0;
  glm::ivec2 min{0}, size{0};  ///< texels of the page
  glm::ivec2 origin{0};        ///< where the chart's rectangle begins, texels of the page
};

struct PagePlan {
  glm::ivec2 size{0};
  int factor = 1;  ///< texels of the picture for one of the page
  std::uint32_t levels = 1;
  int grain = 1;  ///< places and sizes of slots are multiples of it, but for a chart that is alone
  std::vector<Slot> slots;
};

/// The chart's rectangle at a scale, in texels of the page.
inline glm::ivec2 reducedSize(const Chart& chart, int factor) {
  return (chart.size() + factor - 1) / factor;
}

/// Every chart gets one slot. `max_side` is a multiple of 4.
///
/// The last mip level's texels have 2^(levels − 1) texels of the page for a side, the *grain*. Slots lie on multiples
/// of the grain, so that no texel of any level belongs to two charts. Their gutter is half a grain and one texel more
/// wide, so that a bilinear look-up in the last level, which reaches half a texel of that level beyond the chart, stays
/// in the slot. (Without the alignment it would reach one and a half.) The grain is about the mean edge of the
/// triangles, for beyond it a patch is drawn in a coarser form; less, where slots would have more than a third more
/// area than their charts; but at least 2, which gives gutters of 2 texels.
///
/// A chart by itself on a page needs no gutter. Where there is one chart only, or one that fits a page without a gutter
/// but not with it, or only when it is reduced, it gets such a page. All charts are reduced if together they have far
/// more texels than `picture`, whose size is given in texels.
///
/// With a `unit` of more than one texel all charts move by multiples of it, in x and in y each by its own, and slots
/// lie on such multiples; units are 8 or 16 texels. Such pages are never reduced: there are none where some would have
/// to be, nor where they would have more than kMostUnitArea times the texels of pages without a unit and kSmallArea
/// more.
std::vector<PagePlan> planPages(const std::vector<Chart>& charts, const glm::ivec2& picture, int max_side,
                                const glm::ivec2& unit = glm::ivec2(1));
inline constexpr double kMostUnitArea = 1.5;           ///< a choice: beyond, GPUs would hold mostly gutters
inline constexpr std::int64_t kSmallArea = 128 * 128;  ///< texels; a choice, so that a few triangles don't count

/// Moves a chart's triangles to the page, and appends them.
void placeTriangles(const Chart& chart, const PagePlan& plan, const Slot& slot, std::vector<PageTriangle>& placed);

}  // namespace lod::texture
