#pragma once
// Pages that copy the blocks of their picture's JPEG. Private to lod/texture.
#include <cstdint>
#include <vector>

#include "base/jpeg/blocks.h"
#include "lod/texture/page_plan.h"
#include "lod/texture/picture_charts.h"
#include "lod/texture/unit_charts.h"

namespace lod::texture {

/// A JPEG and what all leaves show of it.
struct BlockSource {
  const base::JpegBlocks& blocks;
  const PictureCharts& covered;
  const UnitCharts& units;

  glm::ivec2 size() const { return {blocks.width(), blocks.height()}; }
  glm::ivec2 unit() const { return {blocks.unitWidth(), blocks.unitHeight()}; }
};

/// Makes the JPEG of a page that was planned in units of the source. `first` is what UnitCharts::add() returned for
/// these charts.
///
/// Units that show nothing but one surface, this chart's and what goes on beyond it in other leaves, are copied. So are
/// blocks all of whose texels the chart covers. Of others, the texels of gaps and other charts get colours of those
/// beside them, and the block is coded anew with the source's quantization. Blocks farther than 2 texels from every
/// triangle are even, in colours of those beside them. A texel that a look-up reads is less than 1 from a triangle, and
/// a decoder mixes it with colours of less than 1 more where these are coarser.
base::Result<base::Bytes> drawBlockPage(const BlockSource& source, const std::vector<Chart>& charts,
                                        std::uint32_t first, const PagePlan& plan);

}  // namespace lod::texture
