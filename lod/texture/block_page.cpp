#include "lod/texture/block_page.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <memory>
#include <optional>
#include <vector>

#include "base/check.h"
#include "lod/texture/coverage.h"
#include "lod/texture/dct.h"
#include "lod/texture/fill.h"
#include "lod/texture/wrapped.h"

namespace lod::texture {
namespace {

// Texels this near to a triangle are those of copied or coded blocks.
constexpr double kNeeded = 2.0;
// A block's gaps take the colours of texels up to so many samples beyond it.
constexpr int kApron = 2, kBlock = 8, kSpan = kBlock + 2 * kApron;

// The repetitions of the picture that a chart reaches into, in texels, max excluded. Beyond them the picture's other
// edge lies beside the chart only because pictures repeat. Where a picture is as large as what it shows, as most are,
// that is another place, and a decoder would mix its coarser colours into the chart's last texels.
struct Reach {
  glm::ivec2 min{0}, max{0};

  Reach(const Chart& chart, const glm::ivec2& picture) {
    for (int k = 0; k < 2; ++k) {
      min[k] = chart.min[k] - wrapped(chart.min[k], picture[k]);
      max[k] = chart.max[k] - 1 - wrapped(chart.max[k] - 1, picture[k]) + picture[k];
    }
  }
  bool holds(const glm::ivec2& first, const glm::ivec2& size) const {
    return glm::all(glm::greaterThanEqual(first, min)) && glm::all(glm::lessThanEqual(first + size, max));
  }
};

// The chart's texels in its slot, for blocks that cannot be copied whole.
class SlotTexels {
 public:
  // `wanted`: by unit of the slot, which of them makeBlock() and begin() need; they and their neighbours count.
  SlotTexels(const BlockSource& source, const Chart& chart, std::uint32_t joined, const Slot& slot,
             const std::vector<glm::ivec2>& wanted)
      : source_(source),
        joined_(joined),
        reach_(chart, source.size()),
        at_(chart.min - (slot.origin - slot.min)),
        size_(slot.size),
        unit_(source.unit()),
        shift_(std::countr_zero(static_cast<unsigned>(unit_.x)), std::countr_zero(static_cast<unsigned>(unit_.y))),
        wide_(size_.x / unit_.x) {
    const glm::ivec2 units = size_ / unit_;
    tiles_.resize(static_cast<std::size_t>(units.x) * static_cast<std::size_t>(units.y), kNoTile);
    std::size_t tiles = 0;
    for (const glm::ivec2& unit : wanted)
      for (int y = std::max(unit.y - 1, 0); y <= std::min(unit.y + 1, units.y - 1); ++y)
        for (int x = std::max(unit.x - 1, 0); x <= std::min(unit.x + 1, units.x - 1); ++x)
          if (std::size_t& tile = tiles_[tileIndex({x, y})]; tile == kNoTile) tile = tiles++;
    complete_.resize(tiles);
    kept_.resize(tiles * tileTexels());
    units_.resize(tiles);
    samples_.resize(tiles * base::JpegBlocks::kMostInUnit);
    for (const StepTriangle& triangle : chart.triangles) cover(triangle);
  }

  // Called before makeBlock() for the blocks of a unit of the slot.
  void begin(const glm::ivec2& unit) {
    for (int y = unit.y - 1; y <= unit.y + 1; ++y)
      for (int x = unit.x - 1; x <= unit.x + 1; ++x) completeUnit({x, y});
  }

  // Returns false where the block shows nothing of the chart. x and y count the plane's blocks from the slot's corner.
  bool makeBlock(int plane, int x, int y, base::JpegBlock& block) {
    Span span;
    int inside = 0, any = 0;
    for (int down = -1; down <= 1; ++down)
      for (int across = -1; across <= 1; ++across) {
        const int known =
            addKnown(plane, {x + across, y + down}, {kApron + kBlock * across, kApron + kBlock * down}, span);
        any += known;
        if (across == 0 && down == 0) inside = known;
      }
    if (any == 0) return false;
    if (inside == kBlock * kBlock)
      if (const auto whole = wholeBlock(plane, {x, y})) {
        block = *whole;
        return true;
      }
    fillGaps(span);
    BlockSamples samples;
    for (int j = 0; j < kBlock; ++j)
      for (int i = 0; i < kBlock; ++i) samples[j * kBlock + i] = span.values[Span::at(i + kApron, j + kApron)];
    block = blockOf(samples, source_.blocks.plane(plane).quant);
    return true;
  }

 private:
  using UnitBlocks = std::array<base::JpegBlock, base::JpegBlocks::kMostInUnit>;

  // Samples of a block and around it, with a border of one more.
  struct Span {
    static constexpr int kStride = 16;
    // 0 where the sample is not known; `known` is 1 or 0. Floats, so that a compiler can take many samples at a time.
    std::array<float, (kSpan + 3) * kStride> values{}, known{};
    static int at(int i, int j) { return (j + 1) * kStride + i + 1; }
  };

  // Texels of the picture for a sample of the plane, in x and in y.
  glm::ivec2 texelsPerSample(int plane) const {
    const base::JpegPlane& p = source_.blocks.plane(plane);
    return source_.unit() / glm::ivec2(kBlock * p.across, kBlock * p.down);
  }

  std::size_t tileIndex(const glm::ivec2& unit) const {
    return static_cast<std::size_t>(unit.y) * static_cast<std::size_t>(wide_) + static_cast<std::size_t>(unit.x);
  }
  std::size_t tileTexels() const { return std::size_t{1} << (shift_.x + shift_.y); }

  void cover(const StepTriangle& triangle) {
    const glm::ivec2 unit = unit_, units = size_ / unit;
    glm::ivec2 low = triangle.corners[0] - at_ * kCornerSteps, high = low;
    std::array<glm::ivec2, 3> steps{};
    for (int i = 0; i < 3; ++i) {
      steps[i] = triangle.corners[i] - at_ * kCornerSteps;
      low = glm::min(low, steps[i]), high = glm::max(high, steps[i]);
    }
    // Texels beside the triangle count, too.
    const glm::ivec2 first = glm::max((low / kCornerSteps - 1) / unit, 0);
    const glm::ivec2 last = glm::min((high / kCornerSteps + 1) / unit, units - 1);
    for (int y = first.y; y <= last.y; ++y)
      for (int x = first.x; x <= last.x; ++x) {
        const std::size_t tile = tiles_[tileIndex({x, y})];
        if (tile == kNoTile) continue;
        std::array<glm::dvec2, 3> corners;
        for (int i = 0; i < 3; ++i)
          corners[i] = glm::dvec2(steps[i] - glm::ivec2(x, y) * unit * kCornerSteps) / double{kCornerSteps};
        coverTriangle(corners, PictureCharts::kReach, {&kept_[tile * tileTexels()], unit.x, unit.x, unit.y});
      }
  }

  // Adds the texels of a unit that charts of other leaves cover which hang together with this one.
  void completeUnit(const glm::ivec2& unit) {
    const glm::ivec2 texels = source_.unit(), units = size_ / texels;
    if (unit.x < 0 || unit.y < 0 || unit.x >= units.x || unit.y >= units.y) return;
    const std::size_t tile = tiles_[tileIndex(unit)];
    if (complete_[tile] != 0) return;
    complete_[tile] = 1;
    std::uint8_t* kept = &kept_[tile * tileTexels()];
    for (int y = unit.y * texels.y; y < (unit.y + 1) * texels.y; ++y)
      for (int x = unit.x * texels.x; x < (unit.x + 1) * texels.x; ++x, ++kept) {
        if (*kept != 0 || !reach_.holds(at_ + glm::ivec2(x, y), glm::ivec2(1))) continue;
        const int column = wrapped(at_.x + x, source_.size().x), row = wrapped(at_.y + y, source_.size().y);
        if (source_.covered.covers(column, row) && source_.units.at(column / texels.x, row / texels.y) == joined_)
          *kept = 1;
      }
  }

  // A block of the slot: its unit, and its number among the unit's blocks.
  struct Place {
    glm::ivec2 unit{0};
    std::size_t tile = 0, number = 0;
  };
  Place placeOf(int plane, const glm::ivec2& block) const {
    const base::JpegPlane &p = source_.blocks.plane(plane), &first = source_.blocks.plane(0);
    const glm::ivec2 count(p.across, p.down), unit = block / count, within = block % count;
    const int before = plane == 0 ? 0 : first.across * first.down + plane - 1;
    return {unit, tiles_[tileIndex(unit)], static_cast<std::size_t>(before + within.y * count.x + within.x)};
  }

  // Adds to a span what the chart shows of a block, whose first sample is at (i, j) of the span. Returns how many
  // samples.
  int addKnown(int plane, const glm::ivec2& block, const glm::ivec2& at, Span& span) {
    const glm::ivec2 texels = texelsPerSample(plane);
    const glm::ivec2 first = kBlock * block * texels;
    if (first.x < 0 || first.y < 0 || first.x >= size_.x || first.y >= size_.y) return 0;
    const Place place = placeOf(plane, block);
    const glm::ivec2 within = first & (unit_ - 1);
    const std::uint8_t* const kept = &kept_[place.tile * tileTexels()] + (within.y * unit_.x + within.x);
    const BlockSamples* samples = nullptr;
    int count = 0;
    for (int j = std::max(0, -at.y); j < std::min(kBlock, kSpan - at.y); ++j)
      for (int i = std::max(0, -at.x); i < std::min(kBlock, kSpan - at.x); ++i) {
        bool shown = false;
        for (int y = 0; y < texels.y; ++y)
          for (int x = 0; x < texels.x; ++x) shown |= kept[(j * texels.y + y) * unit_.x + i * texels.x + x] != 0;
        if (!shown) continue;
        if (samples == nullptr) samples = &samplesAt(plane, block, place);
        const int to = Span::at(at.x + i, at.y + j);
        span.values[static_cast<std::size_t>(to)] = (*samples)[static_cast<std::size_t>(j * kBlock + i)];
        span.known[static_cast<std::size_t>(to)] = 1.0F;
        ++count;
      }
    return count;
  }

  // The picture's block at this place of the slot, if all of it lies in the picture.
  std::optional<base::JpegBlock> wholeBlock(int plane, const glm::ivec2& block) {
    const glm::ivec2 first = at_ / texelsPerSample(plane) + kBlock * block;
    const glm::ivec2 end = (first + kBlock) * texelsPerSample(plane);
    if (first.x < 0 || first.y < 0 || end.x > source_.size().x || end.y > source_.size().y) return std::nullopt;
    const Place place = placeOf(plane, block);
    auto& blocks = units_[place.tile];
    if (!blocks) {
      blocks = std::make_unique<UnitBlocks>();
      const glm::ivec2 unit = at_ / unit_ + place.unit;
      source_.blocks.unitBlocks(unit.x, unit.y, *blocks);
    }
    return (*blocks)[place.number];
  }

  const BlockSamples& samplesAt(int plane, const glm::ivec2& block, const Place& place) {
    auto& samples = samples_[place.tile * base::JpegBlocks::kMostInUnit + place.number];
    if (!samples) samples = std::make_unique<BlockSamples>(decode(plane, block));
    return *samples;
  }
  BlockSamples decode(int plane, const glm::ivec2& block) {
    const Quantization& quant = source_.blocks.plane(plane).quant;
    if (const auto whole = wholeBlock(plane, block)) return samplesOf(*whole, quant);
    // It lies across the picture's edge, beyond which the picture begins again.
    BlockSamples samples;
    const glm::ivec2 texels = texelsPerSample(plane);
    base::JpegBlock shown;
    glm::ivec2 shown_at(-1);
    for (int j = 0; j < kBlock; ++j)
      for (int i = 0; i < kBlock; ++i) {
        const glm::ivec2 texel = at_ + (kBlock * block + glm::ivec2(i, j)) * texels;
        const int x = wrapped(texel.x, source_.size().x) / texels.x, y = wrapped(texel.y, source_.size().y) / texels.y;
        if (const glm::ivec2 at(x / kBlock, y / kBlock); at != shown_at) {
          shown = source_.blocks.block(plane, at.x, at.y);
          shown_at = at;
        }
        samples[j * kBlock + i] = sampleOf(shown, quant, x % kBlock, y % kBlock);
      }
    return samples;
  }

  // Fills the block's samples that are not known from known ones around them, again and again.
  static void fillGaps(Span& span) {
    const auto isOpen = [&] {
      float known = 0.0F;
      for (int j = kApron; j < kApron + kBlock; ++j)
        for (int i = kApron; i < kApron + kBlock; ++i) known += span.known[Span::at(i, j)];
      return known < kBlock * kBlock;
    };
    constexpr int kFirst = Span::kStride + 1, kEnd = kFirst + kSpan * Span::kStride;
    static_assert(kEnd + Span::kStride + 1 <= int{std::tuple_size_v<decltype(Span::values)>});
    const auto addAround = [](const float* from, float* to) {
      constexpr int kRow = Span::kStride;
      for (int n = 0; n < kEnd - kFirst; ++n)
        to[n] = from[n - kRow - 1] + from[n - kRow] + from[n - kRow + 1] + from[n - 1] + from[n] + from[n + 1] +
                from[n + kRow - 1] + from[n + kRow] + from[n + kRow + 1];
    };
    while (isOpen()) {
      std::array<float, kEnd> sums, counts;
      addAround(&span.values[kFirst], &sums[kFirst]);
      addAround(&span.known[kFirst], &counts[kFirst]);
      for (int j = 0; j < kSpan; ++j)
        for (int n = Span::at(0, j); n < Span::at(kSpan, j); ++n) {
          if (span.known[n] != 0.0F || counts[n] == 0.0F) continue;
          span.values[n] = sums[n] / counts[n];
          span.known[n] = 1.0F;
        }
    }
  }

  const BlockSource& source_;
  const std::uint32_t joined_;
  const Reach reach_;
  const glm::ivec2 at_;            // the slot's corner in the picture
  const glm::ivec2 size_;          // of the slot, texels
  const glm::ivec2 unit_, shift_;  // texels of a unit: 8 or 16, and the powers of two that these are
  const int wide_;                 // units of the slot in a row
  static constexpr std::size_t kNoTile = ~std::size_t{0};
  std::vector<std::size_t> tiles_;      // by unit of the slot: its number among those that are kept
  std::vector<std::uint8_t> kept_;      // by tile and texel: whether the chart covers it
  std::vector<std::uint8_t> complete_;  // by tile
  // All that was decoded so far, by tile, and by tile and block.
  std::vector<std::unique_ptr<UnitBlocks>> units_;
  std::vector<std::unique_ptr<BlockSamples>> samples_;
};

// A page in the making.
class BlockPage {
 public:
  BlockPage(const BlockSource& source, const PagePlan& plan) : source_(source), plan_(plan) {
    size_ = plan.size / source.unit();
    LUMIGRID_CHECK(size_ * source.unit() == plan.size);
    const auto units = static_cast<std::size_t>(size_.x) * static_cast<std::size_t>(size_.y);
    units_.resize(units);
    const base::JpegPlane& first = source.blocks.plane(0);
    blocks_per_unit_ = static_cast<std::size_t>(first.across * first.down + source.blocks.planes() - 1);
    means_ = base::Image(size_.x * first.across, size_.y * first.down, 3);
    known_.resize(means_.pixels.size() / 3);
  }

  void addSlot(const Chart& chart, std::uint32_t joined, const Slot& slot) {
    const glm::ivec2 at = chart.min - (slot.origin - slot.min);
    const glm::ivec2 units = slot.size / source_.unit(), first = slot.min / source_.unit();
    const std::vector<std::uint8_t> needed = neededUnits(chart, at, units);
    const Reach reach(chart, source_.size());
    std::vector<glm::ivec2> others;  // than those that are copied
    bool shown = false;
    for (int y = 0; y < units.y; ++y)
      for (int x = 0; x < units.x; ++x) {
        if (needed[static_cast<std::size_t>(y) * static_cast<std::size_t>(units.x) + static_cast<std::size_t>(x)] == 0)
          continue;
        const glm::ivec2 to = first + glm::ivec2(x, y);
        const glm::ivec2 shown_unit = at / source_.unit() + glm::ivec2(x, y);
        const bool reached = reach.holds(shown_unit * source_.unit(), source_.unit());
        if (const auto from = reached ? wholeUnit(shown_unit, joined) : std::nullopt) {
          copyUnit(to, *from);
          shown = true;
          continue;
        }
        others.emplace_back(x, y);
      }
    if (!others.empty()) {
      SlotTexels texels(source_, chart, joined, slot, others);
      for (const glm::ivec2& unit : others) shown |= makeUnit(first + unit, unit, texels);
    }
    if (!shown) showPoint(chart, first);
    fillUncovered(meansOf(first, units));
  }

  base::Result<base::Bytes> encode() {
    // Places that are free take colours of the slots beside them.
    std::fill(known_.begin(), known_.end(), std::uint8_t{0});
    for (const Slot& slot : plan_.slots) {
      const FillView view = meansOf(slot.min / source_.unit(), slot.size / source_.unit());
      for (int y = 0; y < view.mask.height; ++y)
        std::memset(view.mask.row(y), 1, static_cast<std::size_t>(view.mask.width));
    }
    fillUncovered(meansOf({0, 0}, size_));
    return source_.blocks.encode(size_.x, size_.y,
                                 [this](int x, int y, base::JpegBlock* blocks) -> std::optional<std::array<int, 2>> {
                                   const Unit& unit = unitAt({x, y});
                                   if (unit.kind == kCopied) return std::array<int, 2>{unit.from.x, unit.from.y};
                                   fillUnit({x, y}, unit, blocks);
                                   return std::nullopt;
                                 });
  }

 private:
  static constexpr std::uint32_t kEven = 0, kCopied = 1, kMade = 2;
  struct Unit {
    std::uint32_t kind = kEven;
    glm::ivec2 from{0};      // in units of the picture, where it is copied
    std::size_t blocks = 0;  // in made_, where it is made
  };

  Unit& unitAt(const glm::ivec2& at) {
    return units_[static_cast<std::size_t>(at.y) * static_cast<std::size_t>(size_.x) + static_cast<std::size_t>(at.x)];
  }

  std::vector<std::uint8_t> neededUnits(const Chart& chart, const glm::ivec2& at, const glm::ivec2& units) const {
    std::vector<std::uint8_t> needed(static_cast<std::size_t>(units.x) * static_cast<std::size_t>(units.y));
    const glm::dvec2 unit(source_.unit());
    const double reach = 0.5 + kNeeded / std::min(unit.x, unit.y);
    const MaskView mask{needed.data(), units.x, units.x, units.y};
    for (const StepTriangle& triangle : chart.triangles) {
      std::array<glm::dvec2, 3> corners;
      for (int i = 0; i < 3; ++i)
        corners[i] = (glm::dvec2(triangle.corners[i]) / double{kCornerSteps} - glm::dvec2(at)) / unit;
      coverTriangle(corners, reach, mask);
    }
    return needed;
  }

  // The picture's unit at this place of the repeated picture, if all of its texels show these joined charts.
  std::optional<glm::ivec2> wholeUnit(const glm::ivec2& at, std::uint32_t joined) const {
    const glm::ivec2 unit = source_.unit(), size = source_.size(), count = size / unit;
    glm::ivec2 from = at;
    for (int k = 0; k < 2; ++k) {
      if (size[k] % unit[k] == 0) from[k] = wrapped(from[k], count[k]);
      if (from[k] < 0 || from[k] >= count[k]) return std::nullopt;
    }
    if (source_.units.at(from.x, from.y) != joined) return std::nullopt;
    if (!source_.covered.coversAll(from * unit, unit)) return std::nullopt;
    return from;
  }

  void copyUnit(const glm::ivec2& to, const glm::ivec2& from) {
    unitAt(to) = {kCopied, from, 0};
    const base::JpegPlane& first = source_.blocks.plane(0);
    std::array<std::uint8_t, 3> mean{};
    for (int plane = 1; plane < source_.blocks.planes(); ++plane)
      mean[static_cast<std::size_t>(plane)] =
          meanOf(source_.blocks.mean(plane, from.x, from.y), source_.blocks.plane(plane).quant);
    for (int y = 0; y < first.down; ++y) {
      const int column = to.x * first.across, row = to.y * first.down + y;
      std::uint8_t* out = means_.at(column, row);
      std::uint8_t* known = &known_[static_cast<std::size_t>(row) * static_cast<std::size_t>(means_.width) +
                                    static_cast<std::size_t>(column)];
      for (int x = 0; x < first.across; ++x, out += 3) {
        const int coefficient = source_.blocks.mean(0, from.x * first.across + x, from.y * first.down + y);
        mean[0] = meanOf(coefficient, first.quant);
        std::copy_n(mean.data(), 3, out);
        known[x] = 1;
      }
    }
  }

  // Codes a unit anew. Returns whether it shows something of the chart.
  bool makeUnit(const glm::ivec2& to, const glm::ivec2& in_slot, SlotTexels& texels) {
    std::vector<base::JpegBlock> blocks(blocks_per_unit_);
    std::vector<std::uint8_t> shows(blocks_per_unit_);
    std::size_t next = 0;
    bool any = false;
    texels.begin(in_slot);
    for (int plane = 0; plane < source_.blocks.planes(); ++plane) {
      const base::JpegPlane& p = source_.blocks.plane(plane);
      for (int y = 0; y < p.down; ++y)
        for (int x = 0; x < p.across; ++x, ++next) {
          shows[next] = texels.makeBlock(plane, in_slot.x * p.across + x, in_slot.y * p.down + y, blocks[next]) ? 1 : 0;
          any |= shows[next] != 0;
        }
    }
    if (!any) return false;
    unitAt(to) = {kMade, {}, made_.size()};
    const base::JpegPlane& first = source_.blocks.plane(0);
    forEachFirstBlock([&](int x, int y) {
      const auto block = static_cast<std::size_t>(y * first.across + x);
      if (shows[block] == 0) return;
      noteMean(to, x, y, 0, blocks[block][0]);
      for (int plane = 1; plane < source_.blocks.planes(); ++plane)
        noteMean(to, x, y, plane, blocks[blocks_per_unit_ - 3 + static_cast<std::size_t>(plane)][0]);
    });
    for (std::size_t i = 0; i < blocks.size(); ++i) made_.push_back({blocks[i], shows[i] != 0});
    return true;
  }

  // Charts without an area get the colour that the picture has there.
  void showPoint(const Chart& chart, const glm::ivec2& to) {
    const glm::ivec2 size = source_.size();
    const glm::ivec2 texel(wrapped(chart.min.x, size.x), wrapped(chart.min.y, size.y));
    for (int plane = 0; plane < source_.blocks.planes(); ++plane) {
      const base::JpegPlane& p = source_.blocks.plane(plane);
      const int x = texel.x * p.across / source_.unit().x, y = texel.y * p.down / source_.unit().y;
      noteMean(to, 0, 0, plane, source_.blocks.mean(plane, x, y));
    }
  }

  void forEachFirstBlock(auto&& body) const {
    const base::JpegPlane& first = source_.blocks.plane(0);
    for (int y = 0; y < first.down; ++y)
      for (int x = 0; x < first.across; ++x) body(x, y);
  }

  // x and y: the block of the first plane in its unit.
  void noteMean(const glm::ivec2& unit, int x, int y, int plane, int coefficient) {
    const base::JpegPlane& first = source_.blocks.plane(0);
    const int column = unit.x * first.across + x, row = unit.y * first.down + y;
    means_.at(column, row)[plane] = meanOf(coefficient, source_.blocks.plane(plane).quant);
    known_[static_cast<std::size_t>(row) * static_cast<std::size_t>(means_.width) + static_cast<std::size_t>(column)] =
        1;
  }
  FillView meansOf(const glm::ivec2& first, const glm::ivec2& units) {
    const base::JpegPlane& plane = source_.blocks.plane(0);
    const int x = first.x * plane.across, y = first.y * plane.down;
    const std::ptrdiff_t offset = std::ptrdiff_t{y} * means_.width + x;
    return {means_.at(x, y),
            std::ptrdiff_t{means_.width} * 3,
            3,
            {known_.data() + offset, means_.width, units.x * plane.across, units.y * plane.down}};
  }

  // Writes the blocks of a unit that is not copied.
  void fillUnit(const glm::ivec2& at, const Unit& unit, base::JpegBlock* blocks) {
    const base::JpegPlane& first = source_.blocks.plane(0);
    std::size_t block = 0;
    for (int plane = 0; plane < source_.blocks.planes(); ++plane) {
      const base::JpegPlane& p = source_.blocks.plane(plane);
      for (int y = at.y * p.down; y < (at.y + 1) * p.down; ++y)
        for (int x = at.x * p.across; x < (at.x + 1) * p.across; ++x, ++block) {
          const bool made = unit.kind == kMade && made_[unit.blocks + block].shows;
          blocks[block] =
              made ? made_[unit.blocks + block].block
                   : flatBlock(means_.at(x * first.across / p.across, y * first.down / p.down)[plane], p.quant);
        }
    }
  }

  struct MadeBlock {
    base::JpegBlock block;
    bool shows;
  };

  const BlockSource& source_;
  const PagePlan& plan_;
  glm::ivec2 size_{0};  // units
  std::size_t blocks_per_unit_ = 0;
  std::vector<Unit> units_;
  std::vector<MadeBlock> made_;
  base::Image means_;                // of the first plane's blocks, and of the others' in their places
  std::vector<std::uint8_t> known_;  // which of them are those of blocks
};

}  // namespace

base::Result<base::Bytes> drawBlockPage(const BlockSource& source, const std::vector<Chart>& charts,
                                        std::uint32_t first, const PagePlan& plan) {
  BlockPage page(source, plan);
  for (const Slot& slot : plan.slots) page.addSlot(charts[slot.chart], source.units.joined(first + slot.chart), slot);
  return page.encode();
}

}  // namespace lod::texture
