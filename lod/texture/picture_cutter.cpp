#include "lod/texture/picture_cutter.h"

#include <algorithm>
#include <utility>

#include "lod/texture/block_page.h"
#include "lod/texture/charts.h"
#include "lod/texture/dct.h"
#include "lod/texture/page_bytes.h"
#include "lod/texture/page_plan.h"
#include "lod/texture/picture_charts.h"
#include "lod/texture/unit_charts.h"

namespace lod::texture {
namespace {

// JPEGs whose blocks take more memory are decoded instead; a choice.
constexpr std::uint64_t kMaxBlockBytes = std::uint64_t{512} << 20;
constexpr int kMaxSide = 4096;  // of pages, texels; a choice: what every GPU takes

std::vector<Chart> chartsOf(std::span<const PictureTriangle> leaf, const glm::ivec2& picture) {
  return foldRepetitions(findCharts(roundTriangles(leaf)), picture);
}

}  // namespace

PictureCutter::PictureCutter(Decode decode) : decode_(std::move(decode)), mutex_(std::make_unique<std::mutex>()) {}
PictureCutter::PictureCutter(PictureCutter&&) noexcept = default;
PictureCutter::~PictureCutter() = default;

base::Result<PictureCutter> PictureCutter::open(base::ByteView bytes, base::ByteView units, Decode decode) {
  PictureCutter cutter(std::move(decode));
  // Other pictures, and broken ones, are named by their decoder.
  if (auto blocks = base::JpegBlocks::read(bytes, kMaxBlockBytes, units)) {
    cutter.size_ = {blocks->width(), blocks->height()};
    cutter.units_ = std::make_unique<UnitCharts>(cutter.size_, glm::ivec2(blocks->unitWidth(), blocks->unitHeight()));
    cutter.blocks_ = std::move(*blocks);
  } else {
    LUMIGRID_ASSIGN_OR_RETURN(cutter.image_, cutter.decode_());
    cutter.size_ = {cutter.image_.width, cutter.image_.height};
  }
  cutter.charts_ = std::make_unique<PictureCharts>(cutter.size_.x, cutter.size_.y);
  return cutter;
}

std::uint32_t PictureCutter::add(std::span<const PictureTriangle> leaf) {
  for (const PictureTriangle& triangle : leaf) charts_->add(triangle);
  return units_ ? units_->add(chartsOf(leaf, size_)) : 0;
}

void PictureCutter::finish() {
  if (units_)
    units_->join();
  else
    charts_->growInto(image_);
}

base::Result<std::vector<EncodedPage>> PictureCutter::cut(std::span<const PictureTriangle> leaf, std::uint32_t number) {
  if (blocks_) {
    LUMIGRID_ASSIGN_OR_RETURN(auto pages, cutBlocks(leaf, number));
    if (!pages.empty()) return pages;
    LUMIGRID_TRY(needImage());
  }
  std::vector<EncodedPage> pages;
  for (Page& page : makePages(image_, leaf, kMaxSide)) {
    LUMIGRID_ASSIGN_OR_RETURN(auto bytes, encodePage(page));
    pages.push_back({std::move(page.triangles), page.scale, std::move(bytes)});
  }
  return pages;
}

// Returns no page where blocks cannot be copied.
base::Result<std::vector<EncodedPage>> PictureCutter::cutBlocks(std::span<const PictureTriangle> leaf,
                                                                std::uint32_t number) const {
  const BlockSource source{*blocks_, *charts_, *units_};
  const std::vector<Chart> charts = chartsOf(leaf, size_);
  std::vector<EncodedPage> pages;
  for (const PagePlan& plan : planPages(charts, size_, kMaxSide, source.unit())) {
    PageLayout layout{plan.size, plan.levels, 1, {}};
    for (const Slot& slot : plan.slots) placeTriangles(charts[slot.chart], plan, slot, layout.triangles);
    std::sort(layout.triangles.begin(), layout.triangles.end(),
              [](const PageTriangle& a, const PageTriangle& b) { return a.triangle < b.triangle; });
    const auto jpeg = drawBlockPage(source, charts, number, plan);
    // libjpeg decodes pictures that it does not write.
    if (!jpeg && jpeg.error().code == base::ErrorCode::kInvalidInput) return std::vector<EncodedPage>();
    if (!jpeg) return jpeg.error();
    LUMIGRID_ASSIGN_OR_RETURN(auto bytes, encodePage(layout, *jpeg));
    pages.push_back({std::move(layout.triangles), 1.0F, std::move(bytes)});
  }
  return pages;
}

base::Result<void> PictureCutter::needImage() {
  const std::lock_guard lock(*mutex_);
  if (!image_.empty()) return {};
  LUMIGRID_ASSIGN_OR_RETURN(auto image, decode_());
  if (glm::ivec2(image.width, image.height) != size_)
    return base::Error{base::ErrorCode::kInvalidInput, "a picture changed while it was read; build the scene again"};
  PictureCharts charts = *charts_;  // growing changes what is covered
  charts.growInto(image);
  image_ = std::move(image);
  return {};
}

glm::vec3 PictureCutter::colorAt(int x, int y) const {
  if (!blocks_) {
    const std::uint8_t* texel = image_.at(x, y);
    return {texel[0], texel[1], texel[2]};
  }
  std::array<float, 3> sample{0.0F, 128.0F, 128.0F};
  std::array<base::JpegBlock, 3> blocks;
  blocks_->blocksAt(x, y, blocks);
  for (int p = 0; p < blocks_->planes(); ++p) {
    const base::JpegPlane& plane = blocks_->plane(p);
    const int column = x * 8 * plane.across / blocks_->unitWidth(), row = y * 8 * plane.down / blocks_->unitHeight();
    sample[static_cast<std::size_t>(p)] =
        sampleOf(blocks[static_cast<std::size_t>(p)], plane.quant, column % 8, row % 8);
  }
  // JFIF 1.02, section 7: RGB of YCbCr.
  const float cb = sample[1] - 128.0F, cr = sample[2] - 128.0F;
  return glm::clamp(sample[0] + glm::vec3(1.402F * cr, -0.344136F * cb - 0.714136F * cr, 1.772F * cb), 0.0F, 255.0F);
}

}  // namespace lod::texture
