#include "repository/sampling/wanted_tiles.h"

#include <algorithm>
#include <span>

#include "base/crc32c.h"

namespace repository {
namespace {

constexpr std::uint8_t kMagic = 'W';
constexpr std::uint8_t kVersion = 1;

std::uint64_t faceOf(std::uint64_t code) {
  return code >> kTileBits;
}
std::uint32_t tileOf(std::uint64_t code) {
  return static_cast<std::uint32_t>(code & ((1U << kTileBits) - 1));
}

/// Four bits at a time, the first in the lower half of a byte.
class NibbleWriter {
 public:
  explicit NibbleWriter(base::ByteWriter& out) : out_(out) {}
  void write(unsigned nibble) {
    if (is_half_)
      out_.u8(static_cast<std::uint8_t>(low_ | nibble << 4U));
    else
      low_ = nibble;
    is_half_ = !is_half_;
  }
  void finish() {
    if (is_half_) write(0);
  }

 private:
  base::ByteWriter& out_;
  unsigned low_ = 0;
  bool is_half_ = false;
};

class NibbleReader {
 public:
  explicit NibbleReader(base::ByteReader& in) : in_(in) {}
  unsigned read() {
    if (!is_half_) byte_ = in_.u8();
    is_half_ = !is_half_;
    return is_half_ ? byte_ & 15U : byte_ >> 4U;
  }
  /// Whether nothing is left in the last byte.
  bool finish() const { return !is_half_ || byte_ >> 4U == 0; }

 private:
  base::ByteReader& in_;
  unsigned byte_ = 0;
  bool is_half_ = false;
};

/// Writes which children of a tile are among those of its face, and the same of them. Tiles from `first_finest` on have
/// none.
void writeChildren(NibbleWriter& out, std::span<const std::uint64_t> face, std::uint32_t first_finest,
                   std::uint32_t tile = 0) {
  if (tile >= first_finest) return;
  unsigned children = 0;
  const auto has = [&](std::uint32_t child) {
    return std::any_of(face.begin(), face.end(), [&](std::uint64_t code) { return tileOf(code) == child; });
  };
  for (std::uint32_t c = 0; c < 4; ++c) children |= has(childOfTile(tile, c)) ? 1U << c : 0U;
  out.write(children);
  for (std::uint32_t c = 0; c < 4; ++c)
    if ((children >> c & 1U) != 0) writeChildren(out, face, first_finest, childOfTile(tile, c));
}

void readChildren(NibbleReader& in, std::uint64_t face, std::uint32_t first_finest, std::vector<std::uint64_t>& codes,
                  std::uint32_t tile = 0) {
  if (tile >= first_finest) return;
  const unsigned children = in.read();
  for (std::uint32_t c = 0; c < 4; ++c) {
    if ((children >> c & 1U) == 0) continue;
    codes.push_back(face << kTileBits | childOfTile(tile, c));
    readChildren(in, face, first_finest, codes, childOfTile(tile, c));
  }
}

base::Error damaged() {
  return {base::ErrorCode::kInvalidInput, "the tiles chosen by use are damaged"};
}

}  // namespace

WantedTiles::WantedTiles(const std::vector<FaceKey>& keys) {
  for (FaceKey key : keys)
    for (; key.tile != 0; key.tile = parentOfTile(key.tile)) codes_.push_back(key.code());
  std::sort(codes_.begin(), codes_.end());
  codes_.erase(std::unique(codes_.begin(), codes_.end()), codes_.end());
}

bool WantedTiles::has(const FaceKey& key) const {
  return key.tile == 0 || std::binary_search(codes_.begin(), codes_.end(), key.code());
}

std::vector<std::uint32_t> WantedTiles::ofFace(const FaceKey& face) const {
  std::vector<std::uint32_t> tiles{0};
  const std::uint64_t first = face.face().code();
  for (auto code = std::lower_bound(codes_.begin(), codes_.end(), first);
       code != codes_.end() && faceOf(*code) == faceOf(first); ++code)
    tiles.push_back(tileOf(*code));
  return tiles;
}

base::Bytes WantedTiles::encode(const Grid& grid) const {
  base::ByteWriter out;
  out.u8(kMagic);
  out.u8(kVersion);
  const std::span<const std::uint64_t> codes(codes_);
  std::uint64_t before = 0;
  for (std::size_t i = 0; i < codes.size();) {
    std::size_t end = i;
    while (end < codes.size() && faceOf(codes[end]) == faceOf(codes[i])) ++end;
    out.varint(faceOf(codes[i]) - before);
    before = faceOf(codes[i]);
    NibbleWriter nibbles(out);
    writeChildren(nibbles, codes.subspan(i, end - i), firstTileOf(grid.tile_depth));
    nibbles.finish();
    i = end;
  }
  out.u32(base::crc32c(out.view()));
  return out.takeBytes();
}

base::Result<WantedTiles> WantedTiles::decode(const Grid& grid, base::ByteView bytes) {
  constexpr std::size_t kEnd = 4;
  if (bytes.size() < 2 + kEnd) return damaged();
  base::ByteReader in(bytes.first(bytes.size() - kEnd));
  base::ByteReader end(bytes.last(kEnd));
  if (end.u32() != base::crc32c(bytes.first(bytes.size() - kEnd))) return damaged();
  if (in.u8() != kMagic || in.u8() != kVersion) return damaged();
  WantedTiles wanted;
  std::uint64_t face = 0;
  while (in.ok() && !in.atEnd()) {
    const bool is_first = wanted.codes_.empty();
    const std::uint64_t step = in.varint();
    if (!in.ok() || (step == 0 && !is_first) || step > (~std::uint64_t{0} >> kTileBits) - face) return damaged();
    face += step;
    const auto key = FaceKey::fromCode(face << kTileBits);
    if (!key || !grid.contains(*key)) return damaged();
    const std::size_t count = wanted.codes_.size();
    NibbleReader nibbles(in);
    readChildren(nibbles, face, firstTileOf(grid.tile_depth), wanted.codes_);
    if (!in.ok() || !nibbles.finish() || wanted.codes_.size() == count) return damaged();
    std::sort(wanted.codes_.begin() + static_cast<std::ptrdiff_t>(count), wanted.codes_.end());
  }
  return wanted;
}

}  // namespace repository
