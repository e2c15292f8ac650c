#include "lod/qsplat/coded_block.h"

#include <cmath>

#include "base/crc32c.h"

namespace lod::qsplat {
namespace {

struct ReadingCoder {
  SymbolReader& reader;
  std::uint32_t code(std::uint32_t context, std::uint32_t) { return reader.symbol(context); }
};

struct CollectingCoder {
  std::vector<SymbolWriter::Symbol>& symbols;
  std::uint32_t code(std::uint32_t context, std::uint32_t symbol) {
    symbols.push_back({static_cast<std::uint16_t>(context), static_cast<std::uint8_t>(symbol)});
    return symbol;
  }
};

struct CountingCoder {
  SymbolCounts& counts;
  std::uint32_t code(std::uint32_t context, std::uint32_t symbol) {
    ++counts[context][symbol];
    return symbol;
  }
};

constexpr std::size_t kChecksumBytes = sizeof(std::uint32_t);

/// Checksum of a coded block that also covers the plain one, whose own checksum covers its number.
std::uint32_t checksumOf(base::ByteView coded, const std::uint8_t* plain) {
  std::uint32_t of_plain = 0;
  std::memcpy(&of_plain, plain + kPayloadBytes, sizeof(of_plain));
  return base::crc32c(coded.subspan(kChecksumBytes), of_plain);
}

std::uint64_t readSix(base::ByteReader& in) {
  const std::uint64_t low = in.u32();
  return low | std::uint64_t{in.u16()} << 32;
}

/// Appends the low `count` bytes of `value`.
void append(base::Bytes& out, std::uint64_t value, int count) {
  for (int i = 0; i < count; ++i) out.push_back(static_cast<std::uint8_t>(value >> 8 * i));
}

/// Codes all groups of a block with a BlockModel of this coder.
template <class Coder>
void codeGroups(const std::uint8_t* plain, std::span<const GroupShape> groups, const Header& header, Coder coder) {
  const GroupLayout layout(header);
  BlockModel<Coder> model(coder, header.colors);
  for (const GroupShape& shape : groups) {
    GroupNodes group;
    group.count = shape.nodes;
    group.has_pointer = shape.has_pointer;
    for (std::uint32_t i = 0; i < group.count; ++i) group.nodes[i] = readNode(plain, i, layout);
    model.code(group);
    plain += layout.bytes(group.count, group.has_pointer);
  }
}

}  // namespace

const std::array<int, kNormalSide>& cellTangents() {
  static const std::array<int, kNormalSide> tangents = [] {
    std::array<int, kNormalSide> made{};
    for (std::uint32_t i = 0; i < kNormalSide; ++i)
      made[i] = static_cast<int>(std::lround(1024.0 * cellBorder(i + 0.5)));
    return made;
  }();
  return tangents;
}

base::Result<BlockCoder> BlockCoder::fromHeader(base::ByteView front, const Header& header) {
  SymbolLevels levels;
  if (!unpackLevels(codedTables(front, header), header.colors, levels)) return damaged("header: its tables are none");
  return BlockCoder(header, levels);
}

bool BlockCoder::decode(std::uint64_t number, base::ByteView coded, std::uint8_t* plain, ChildBlocks& children) const {
  base::ByteReader in(coded);
  const std::uint32_t checksum = in.u32();
  const std::uint32_t groups = in.u8();
  const std::uint32_t child_blocks = in.u8();
  if (!readChildren(number, child_blocks, in, children)) return false;

  const base::ByteView rest = in.bytes(in.remaining());
  if (groups == 0) {
    if (rest.size() != kPayloadBytes) return false;
    std::copy(rest.begin(), rest.end(), plain);
  } else if (!decodeGroups(groups, rest, children, plain)) {
    return false;
  }
  sealBlock(plain, static_cast<std::uint32_t>(number));
  return checksum == checksumOf(coded, plain);
}

bool BlockCoder::readChildren(std::uint64_t number, std::uint32_t count, base::ByteReader& in,
                              ChildBlocks& children) const {
  children = {};
  if (count == 0) return in.ok();
  if (count > kMaxChildBlocks) return false;
  children.first_group = readSix(in);
  children.offset = readSix(in);
  children.count = count;
  std::uint64_t end = children.offset;
  for (std::uint32_t i = 0; i < count; ++i) {
    children.bytes[i] = in.u16();
    end += children.bytes[i];
    if (children.bytes[i] < kMinCodedBytes || children.bytes[i] > kMaxCodedBytes) return false;
  }
  return in.ok() && children.firstBlock() >= number && children.firstBlock() + count <= header_.blocks() &&
         children.offset >= header_.header_bytes && end <= header_.coded_bytes;
}

bool BlockCoder::decodeGroups(std::uint32_t groups, base::ByteView symbols, const ChildBlocks& children,
                              std::uint8_t* plain) const {
  SymbolReader reader(tables_, symbols);
  ReadingCoder coder{reader};
  BlockModel<ReadingCoder> model(coder, header_.colors);
  ChildLayout pointers(layout_, children.first_group);
  std::fill_n(plain, kPayloadBytes, std::uint8_t{0});
  std::uint32_t within = 0;
  for (std::uint32_t g = 0; g < groups; ++g) {
    GroupNodes group;
    if (!model.code(group)) return false;
    const std::uint32_t bytes = layout_.bytes(group.count, group.has_pointer);
    if (within + bytes > kPayloadBytes) return false;
    std::uint8_t* const pointer = writeNodes(group, layout_, plain + within);
    if (group.has_pointer) {
      const std::uint64_t half = pointers.next(group) / 2;
      if (half == 0 || half >> (8 * layout_.pointer_bytes - 1) >> 1 != 0) return false;
      std::memcpy(pointer, &half, layout_.pointer_bytes);
    }
    within += bytes;
  }
  const std::uint64_t last = pointers.last() / kBlockBytes;
  return reader.endedWell() && (children.count == 0 ? last == 0 : last == children.firstBlock() + children.count - 1);
}

base::Bytes BlockCoder::encode(const std::uint8_t* plain, std::span<const GroupShape> groups,
                               const ChildBlocks& children) const {
  std::vector<SymbolWriter::Symbol> symbols;
  codeGroups(plain, groups, header_, CollectingCoder{symbols});
  base::Bytes coded;
  const bool fits = SymbolWriter::append(tables_, symbols, coded) && coded.size() < kPayloadBytes;
  if (!fits) coded.assign(plain, plain + kPayloadBytes);

  base::Bytes out(kChecksumBytes);
  append(out, fits ? groups.size() : 0, 1);
  append(out, children.count, 1);
  if (children.count > 0) {
    append(out, children.first_group, 6);
    append(out, children.offset, 6);
  }
  for (std::uint32_t i = 0; i < children.count; ++i) append(out, children.bytes[i], 2);
  out.insert(out.end(), coded.begin(), coded.end());
  const std::uint32_t checksum = checksumOf(out, plain);
  std::memcpy(out.data(), &checksum, kChecksumBytes);
  return out;
}

void countSymbols(const std::uint8_t* plain, std::span<const GroupShape> groups, const Header& header,
                  SymbolCounts& counts) {
  codeGroups(plain, groups, header, CountingCoder{counts});
}

}  // namespace lod::qsplat
