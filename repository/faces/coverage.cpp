#include "repository/faces/coverage.h"

#include <algorithm>
#include <array>
#include <string>

#include "base/check.h"

// The mask is cut into blocks of 8 × 8 pixels. A block is all background, all model, or mixed. An adaptive binary range
// coder codes the blocks' classes and the pixels of mixed blocks. The coder is that of LZMA (Pavlov; Martin 1979), and
// the pixels' contexts are those of JBIG (ITU-T T.82, figure 13: ten pixels of three lines). Unlike JBIG it codes only
// the pixels of mixed blocks, which makes decoding fast where a block is uniform. All arithmetic is on integers, so
// every machine decodes the same mask.
//
// Rows of blocks go from top to bottom. A row has first the classes of its blocks from left to right, then its pixel
// lines, each over the mixed blocks only. So a pixel's context is complete up to its upper right, as in a mask that is
// coded line by line.

namespace repository {
namespace {

constexpr int kBlock = 8;
constexpr int kMaxSide = 16384;
constexpr std::uint8_t kMaskVersion = 1;
constexpr std::size_t kMaskHeaderBytes = 1;

// ---- The range coder ----

// The format fixes these numbers (docs/formats/repository.md, "Coder").
constexpr std::uint32_t kMinRange = 1U << 24;  // LZMA's: below it a byte is shifted out
constexpr int kProbabilityBits = 16;
constexpr std::uint32_t kMinProbability = 48;  // share of 65536, for either symbol
constexpr std::uint8_t kMaxCount = 40;         // symbols after which the rate of learning stays at 1 / 41.5

// rates[n] = 65536 / (n + 1.5). After n symbols the next one moves the probability by about its share, so that a
// context learns fast from its first symbols.
constexpr std::array<std::uint32_t, kMaxCount + 1> makeRates() {
  std::array<std::uint32_t, kMaxCount + 1> rates{};
  for (std::uint32_t n = 0; n <= kMaxCount; ++n) rates[n] = 2 * 65536 / (2 * n + 3);
  return rates;
}
constexpr auto kRates = makeRates();

// The probability of a zero in one context, learned from the symbols seen there.
struct Model {
  std::uint16_t zero = 32768;  // share of 65536
  std::uint8_t count = 0;

  void updateProbability(bool bit) {
    const std::uint32_t rate = kRates[count];
    std::uint32_t p = zero;
    p = bit ? p - (p * rate >> 16) : p + ((65536 - p) * rate >> 16);
    zero = static_cast<std::uint16_t>(std::clamp(p, kMinProbability, 65536 - kMinProbability));
    if (count < kMaxCount) ++count;
  }
};

class RangeEncoder {
 public:
  explicit RangeEncoder(base::Bytes& out) : out_(out) {}

  void code(Model& model, bool bit) {
    const std::uint32_t bound = (range_ >> kProbabilityBits) * model.zero;
    if (bit) {
      low_ += bound;
      range_ -= bound;
    } else {
      range_ = bound;
    }
    model.updateProbability(bit);
    while (range_ < kMinRange) {
      range_ <<= 8;
      shiftLow();
    }
  }
  // Writes the remaining bytes, so that the decoder's look-ahead of four bytes ends exactly at the end.
  void finish() {
    for (int i = 0; i < 5; ++i) shiftLow();
  }

 private:
  // Shifts out the top byte of low_. Bytes of 0xFF wait, because a carry may still run through them.
  void shiftLow() {
    if (low_ < 0xFF000000U || low_ > 0xFFFFFFFFU) {
      const auto carry = static_cast<std::uint8_t>(low_ >> 32);
      if (has_cache_) out_.push_back(static_cast<std::uint8_t>(cache_ + carry));
      for (; waiting_ > 0; --waiting_) out_.push_back(static_cast<std::uint8_t>(0xFF + carry));
      cache_ = static_cast<std::uint8_t>(low_ >> 24);
      has_cache_ = true;
    } else {
      ++waiting_;
    }
    low_ = (low_ & 0x00FFFFFFU) << 8;
  }

  base::Bytes& out_;
  std::uint64_t low_ = 0;
  std::uint32_t range_ = 0xFFFFFFFF;
  std::uint64_t waiting_ = 0;
  std::uint8_t cache_ = 0;
  bool has_cache_ = false;  // false at first, which leaves out LZMA's first byte: it is always 0
};

class RangeDecoder {
 public:
  explicit RangeDecoder(base::ByteView in) : in_(in) {
    for (int i = 0; i < 4; ++i) value_ = value_ << 8 | next();
  }

  bool decode(Model& model) {
    const std::uint32_t bound = (range_ >> kProbabilityBits) * model.zero;
    const bool bit = value_ >= bound;
    if (bit) {
      value_ -= bound;
      range_ -= bound;
    } else {
      range_ = bound;
    }
    model.updateProbability(bit);
    while (range_ < kMinRange) {
      range_ <<= 8;
      value_ = value_ << 8 | next();
    }
    return bit;
  }
  bool overran() const { return overran_; }
  bool atEnd() const { return !overran_ && at_ == in_.size(); }

 private:
  std::uint32_t next() {
    if (at_ < in_.size()) return in_[at_++];
    overran_ = true;
    return 0;
  }
  base::ByteView in_;
  std::size_t at_ = 0;
  std::uint32_t value_ = 0;
  std::uint32_t range_ = 0xFFFFFFFF;
  bool overran_ = false;
};

// ---- Contexts ----

enum BlockClass : std::uint8_t { kAllBackground = 0, kAllModel = 1, kMixed = 2 };

// The classes of the blocks to the left, above and above right select one of 27 models for "mixed?" and for "model?".
struct Models {
  std::array<Model, 27> mixed;
  std::array<Model, 27> model;
  std::array<Model, 1024> pixel;
};

// The current pixel line and the two before, each with background before its first pixel and behind its last.
class Lines {
 public:
  explicit Lines(int blocks) : stride_(static_cast<std::size_t>(blocks) * kBlock + 4) {
    for (auto& line : lines_) line.assign(stride_, 0);
  }
  std::uint8_t* at(int y) { return lines_[static_cast<std::size_t>(y + 3) % 3].data() + 2; }

 private:
  std::size_t stride_;
  std::array<std::vector<std::uint8_t>, 3> lines_;
};

// The classes of the row above and of the current row, each with a background block at either end.
struct Classes {
  std::vector<std::uint8_t> above;
  std::vector<std::uint8_t> here;
  explicit Classes(int columns) : above(static_cast<std::size_t>(columns) + 2, kAllBackground), here(above) {}
  std::size_t context(std::size_t column) const {
    return here[column] * 9U + above[column + 1] * 3U + above[column + 2];
  }
};

// JBIG's three-line template around the pixel at `x`: −1..+1 two lines up, −2..+2 one line up, and two to the left.
struct PixelContext {
  std::uint32_t two_up;
  std::uint32_t one_up;
  std::uint32_t left;
  PixelContext(const std::uint8_t* up2, const std::uint8_t* up1, const std::uint8_t* line, int x)
      : two_up(static_cast<std::uint32_t>(up2[x - 1] << 1 | up2[x])),
        one_up(static_cast<std::uint32_t>(up1[x - 2] << 3 | up1[x - 1] << 2 | up1[x] << 1 | up1[x + 1])),
        left(static_cast<std::uint32_t>(line[x - 2] << 1 | line[x - 1])) {}
  // Shifts in the pixels that enter the template on the right and returns the number of the context.
  std::uint32_t enter(std::uint8_t up2_right, std::uint8_t up1_right2) {
    two_up = (two_up << 1 | up2_right) & 7U;
    one_up = (one_up << 1 | up1_right2) & 31U;
    return two_up << 7 | one_up << 2 | left;
  }
  void leave(bool bit) { left = (left << 1 | static_cast<std::uint32_t>(bit)) & 3U; }
};

// ---- Encoder ----

BlockClass classOf(const base::Image& mask, int column, int row) {
  const int x1 = std::min(mask.width, (column + 1) * kBlock);
  const int y1 = std::min(mask.height, (row + 1) * kBlock);
  bool any_model = false;
  bool any_background = false;
  for (int y = row * kBlock; y < y1; ++y) {
    for (int x = column * kBlock; x < x1; ++x) (*mask.at(x, y) != 0 ? any_model : any_background) = true;
  }
  return any_model && any_background ? kMixed : any_model ? kAllModel : kAllBackground;
}

void encodeClasses(const base::Image& mask, int row, Classes& classes, Models& models, RangeEncoder& coder) {
  const int columns = static_cast<int>(classes.here.size()) - 2;
  for (int column = 0; column < columns; ++column) {
    const BlockClass block = classOf(mask, column, row);
    const std::size_t context = classes.context(static_cast<std::size_t>(column));
    coder.code(models.mixed[context], block == kMixed);
    if (block != kMixed) coder.code(models.model[context], block == kAllModel);
    classes.here[static_cast<std::size_t>(column) + 1] = block;
  }
}

void encodeLine(const base::Image& mask, int y, const Classes& classes, Lines& lines, Models& models,
                RangeEncoder& coder) {
  std::uint8_t* line = lines.at(y);
  for (int x = 0; x < mask.width; ++x) line[x] = *mask.at(x, y) != 0 ? 1 : 0;

  for (int x0 = 0; x0 < mask.width; x0 += kBlock) {
    if (classes.here[static_cast<std::size_t>(x0 / kBlock) + 1] != kMixed) continue;
    PixelContext context(lines.at(y - 2), lines.at(y - 1), line, x0);
    for (int x = x0; x < std::min(mask.width, x0 + kBlock); ++x) {
      const std::uint32_t number = context.enter(lines.at(y - 2)[x + 1], lines.at(y - 1)[x + 2]);
      coder.code(models.pixel[number], line[x] != 0);
      context.leave(line[x] != 0);
    }
  }
}

// ---- Decoder ----

void decodeClasses(Classes& classes, Models& models, RangeDecoder& coder) {
  for (std::size_t column = 0; column + 2 < classes.here.size(); ++column) {
    const std::size_t context = classes.context(column);
    std::uint8_t block = kMixed;
    if (!coder.decode(models.mixed[context])) block = coder.decode(models.model[context]) ? kAllModel : kAllBackground;
    classes.here[column + 1] = block;
  }
}

void decodeLine(int y, int width, const Classes& classes, Lines& lines, Models& models, RangeDecoder& coder) {
  const std::uint8_t* up2 = lines.at(y - 2);
  const std::uint8_t* up1 = lines.at(y - 1);
  std::uint8_t* line = lines.at(y);
  for (std::size_t column = 0; column + 2 < classes.here.size(); ++column) {
    const int x0 = static_cast<int>(column) * kBlock;
    const std::uint8_t block = classes.here[column + 1];
    if (block != kMixed) {
      std::fill_n(line + x0, std::min(kBlock, width - x0), static_cast<std::uint8_t>(block == kAllModel));
      continue;
    }
    PixelContext context(up2, up1, line, x0);
    for (int x = x0; x < std::min(width, x0 + kBlock); ++x) {
      const bool bit = coder.decode(models.pixel[context.enter(up2[x + 1], up1[x + 2])]);
      line[x] = bit ? 1 : 0;
      context.leave(bit);
    }
  }
}

base::Error badCoverage(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "coverage mask: " + problem};
}

}  // namespace

base::Bytes encodeCoverage(const base::Image& mask) {
  LUMIGRID_CHECK_EQ(mask.channels, 1);
  LUMIGRID_CHECK(mask.width >= 1 && mask.height >= 1 && mask.width <= kMaxSide && mask.height <= kMaxSide);
  if (std::find(mask.pixels.begin(), mask.pixels.end(), std::uint8_t{0}) == mask.pixels.end()) return {};

  base::Bytes out = {kMaskVersion};
  RangeEncoder coder(out);
  Models models;
  const int columns = (mask.width + kBlock - 1) / kBlock;
  Classes classes(columns);
  Lines lines(columns);
  for (int y = 0; y < mask.height; ++y) {
    if (y % kBlock == 0) {
      std::swap(classes.above, classes.here);
      encodeClasses(mask, y / kBlock, classes, models, coder);
    }
    encodeLine(mask, y, classes, lines, models, coder);
  }
  coder.finish();
  return out;
}

base::Result<base::Image> decodeCoverage(base::ByteView bytes, int width, int height) {
  LUMIGRID_CHECK(width >= 1 && height >= 1 && width <= kMaxSide && height <= kMaxSide);
  base::Image mask(width, height, 1);
  if (bytes.empty()) {
    std::fill(mask.pixels.begin(), mask.pixels.end(), std::uint8_t{255});
    return mask;
  }
  if (bytes[0] != kMaskVersion)
    return base::Error{base::ErrorCode::kVersion, "coverage mask: version " + std::to_string(bytes[0]) +
                                                      ", this program reads " + std::to_string(kMaskVersion)};

  RangeDecoder coder(bytes.subspan(kMaskHeaderBytes));
  Models models;
  const int columns = (width + kBlock - 1) / kBlock;
  Classes classes(columns);
  Lines lines(columns);
  for (int y = 0; y < height; ++y) {
    if (y % kBlock == 0) {
      std::swap(classes.above, classes.here);
      classes.here.front() = kAllBackground;
      decodeClasses(classes, models, coder);
      if (coder.overran()) return badCoverage("cut short");
    }
    decodeLine(y, width, classes, lines, models, coder);
    const std::uint8_t* line = lines.at(y);
    std::transform(line, line + width, mask.at(0, y),
                   [](std::uint8_t bit) { return static_cast<std::uint8_t>(bit != 0 ? 255 : 0); });
  }
  if (!coder.atEnd()) return badCoverage(coder.overran() ? "cut short" : "bytes left over");
  return mask;
}

}  // namespace repository
