#include "repository/packs/pack_format.h"

#include <gtest/gtest.h>

#include <set>

#include "base/crc32c.h"
#include "repository/faces/face_value.h"

namespace repository {
namespace {

using base::Bytes;
using base::ByteView;
using base::ErrorCode;

// The worked example of docs/formats/packs.md has the faces of point (0, 0, 0): 0 … 4 hold a JPEG of 3 bytes, 5 is
// empty.
constexpr std::uint64_t kFace = 1U << kTileBits;
const std::vector<PackEntry> kEntries{{0, 19},         {kFace, 19},     {2 * kFace, 19},
                                      {3 * kFace, 19}, {4 * kFace, 19}, {5 * kFace, 0}};

Bytes workedValues() {
  const Bytes jpeg{0xff, 0xd8, 0xd9};
  const Bytes value = encodeFaceValue({false, jpeg, {}});
  Bytes values;
  for (int i = 0; i < 5; ++i) values.insert(values.end(), value.begin(), value.end());
  return values;
}

const ObjectId kId{1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16};

Bytes workedIndex(const Bytes& pack) {
  IndexBuilder builder;
  builder.addPack(kEntries);
  return *builder.build({{kId, pack.size(), 0, 5 * kFace, 6}}, "{}", {95, 15, 0});
}

std::uint64_t u64At(const Bytes& bytes, std::size_t offset) {
  base::ByteReader in(ByteView(bytes).subspan(offset));
  return in.u64();
}

// Writes another value at an offset of the header and makes the checksum fit.
template <class T>
Bytes withHeader(Bytes bytes, std::size_t header_bytes, std::size_t offset, T value) {
  std::memcpy(bytes.data() + offset, &value, sizeof(T));
  const std::uint32_t crc = base::crc32c(ByteView(bytes).first(header_bytes - 4));
  std::memcpy(bytes.data() + header_bytes - 4, &crc, sizeof(crc));
  return bytes;
}

TEST(PackFormat, namesAreReadBack) {
  EXPECT_EQ(packName(kId), "images/pack-0102030405060708090a0b0c0d0e0f10.lgk");
  EXPECT_EQ(indexName(kId), "images/index-0102030405060708090a0b0c0d0e0f10.lgi");
  EXPECT_EQ(idOfPackName(packName(kId)), kId);
  EXPECT_EQ(idOfIndexName(indexName(kId)), kId);
  for (const char* other :
       {"", "images/pack-.lgk", "images/pack-0102030405060708090a0b0c0d0e0f1.lgk",
        "images/pack-0102030405060708090A0B0C0D0E0F10.lgk", "images/pack-0102030405060708090a0b0c0d0e0f10.lgi",
        "images/pack-0102030405060708090a0b0c0d0e0f10.lgk.part12", "pack-0102030405060708090a0b0c0d0e0f10.lgk"})
    EXPECT_EQ(idOfPackName(other), std::nullopt) << other;
}

TEST(PackFormat, encodePackMatchesTheDocumentedExample) {
  const Bytes pack = encodePack(kEntries, workedValues());
  ASSERT_EQ(pack.size(), 185U);
  EXPECT_EQ(u64At(pack, 16), 185U);
  EXPECT_EQ(u64At(pack, 24), 159U);
  EXPECT_EQ(u64At(pack, 24 + 8), 6U);
  EXPECT_EQ(u64At(pack, 48), 5 * kFace);
  EXPECT_EQ(base::hexOf(ByteView(pack).subspan(159)),
            "0000000000000080"
            "3f00000000000000"
            "40000000"
            "131313131300");
  EXPECT_EQ(base::hexOf(ByteView(pack).subspan(56, 8)), "e72e99085458019b");

  const auto table = decodePack(pack);
  ASSERT_TRUE(table) << table.error().message;
  EXPECT_EQ(table->entries, kEntries);
  EXPECT_EQ(table->offsets, (std::vector<std::uint32_t>{64, 83, 102, 121, 140, 159}));
}

TEST(PackFormat, indexMatchesTheDocumentedExample) {
  const Bytes index = workedIndex(encodePack(kEntries, workedValues()));
  ASSERT_EQ(index.size(), 32816U);
  const auto root = decodeIndexRoot(ByteView(index).first(kIndexFrontBytes));
  ASSERT_TRUE(root) << root.error().message;
  EXPECT_EQ(root->object_bytes, 32816U);
  EXPECT_EQ(root->keys, 6U);
  EXPECT_EQ(root->empty, 1U);
  EXPECT_EQ(root->totals, (ValueTotals{95, 15, 0}));
  EXPECT_EQ(root->blocks, 1U);
  EXPECT_EQ(root->blocks_offset, 16384U);
  EXPECT_EQ(root->rowsOffset(), 32768U);
  EXPECT_EQ(root->parameter_crc, base::crc32c(ByteView(index).subspan(128, 2)));
  EXPECT_TRUE(checkParameters(*root, ByteView(index).subspan(parameterOffset(), 2)));
  EXPECT_FALSE(checkParameters(*root, ByteView(index).subspan(parameterOffset() + 1, 2)));
  EXPECT_EQ(base::hexOf(ByteView(index).subspan(100, 8)), "aad07b296ea81136");
  EXPECT_EQ(base::hexOf(ByteView(index).subspan(124, 4)), "f30d695a");
  EXPECT_EQ(base::hexOf(ByteView(index).subspan(16384, 4)), "0c3389d2");

  EXPECT_EQ(root->frontBytes(), 131U);
  EXPECT_EQ(root->fill, Bytes{0}) << "56 bytes are less than a 256th of the block";
  EXPECT_EQ(base::hexOf(ByteView(index).subspan(108, 8)), "0100000051537d52");

  const auto block = decodeIndexBlock(*root, 0, ByteView(index).subspan(root->blockOffset(0), root->bytesToRead(0)));
  ASSERT_TRUE(block) << block.error().message;
  EXPECT_EQ(root->bytesToRead(0), 64U);
  EXPECT_EQ(base::hexOf(ByteView(index).subspan(root->blockOffset(0) + 4, 8)), "3800000001000100");
  EXPECT_EQ(block->keys(), 6U);
  EXPECT_EQ(block->emptyFlags(), 1U);
  EXPECT_EQ(block->find(0), (FaceLocation{kId, 64, 19}));
  EXPECT_EQ(block->find(4 * kFace), (FaceLocation{kId, 140, 19}));
  EXPECT_EQ(block->find(5 * kFace)->length, 0U);
  EXPECT_EQ(block->find(8 * kFace), std::nullopt);
  EXPECT_EQ(block->find(64 * kFace), std::nullopt);
  EXPECT_EQ(block->find(1), std::nullopt) << "a tile of a face that has none";

  const auto rows = decodePackRows(*root, ByteView(index).subspan(root->rowsOffset()));
  ASSERT_TRUE(rows) << rows.error().message;
  EXPECT_EQ(*rows, (std::vector<PackRow>{{kId, 185, 0, 5 * kFace, 6}}));
}

class KeysOfDepth : public ::testing::TestWithParam<std::uint32_t> {};
INSTANTIATE_TEST_SUITE_P(PackFormat, KeysOfDepth, ::testing::Values(0U, 1U, 3U, 5U));

TEST_P(KeysOfDepth, everyOneIsLocated) {
  // Cells are scattered and dense, packs end within a cell, and lengths take varints of every size. Some faces have all
  // tiles that their depth allows, some the first alone.
  std::set<std::uint64_t> codes;
  const std::uint32_t tiles = firstTileOf(GetParam() + 1);
  for (std::uint32_t i = 0; codes.size() < 18000; ++i)
    for (std::uint32_t d = 0; d < 6; ++d)
      for (std::uint32_t tile = 0; tile < ((i + d) % 3 == 0 ? 1 : tiles); ++tile)
        codes.insert(FaceKey{i * 7919U % 4096U, i * 104729U % 512U, i / 3, d, tile}.code());
  std::vector<PackRow> rows;
  std::vector<PackEntry> entries;
  std::vector<std::pair<std::uint64_t, FaceLocation>> places;
  IndexBuilder builder;
  std::uint64_t offset = kPackHeaderBytes;
  const auto end = [&] {
    ObjectId id = kId;
    id[0] = static_cast<std::uint8_t>(rows.size());
    id[1] = static_cast<std::uint8_t>(rows.size() >> 8);
    builder.addPack(entries);
    for (std::size_t i = places.size() - entries.size(); i < places.size(); ++i) places[i].second.pack = id;
    rows.push_back({id, offset, entries.front().code, entries.back().code, entries.size()});
    entries.clear();
    offset = kPackHeaderBytes;
  };
  std::uint64_t keys = 0;
  for (const std::uint64_t code : codes) {
    const std::uint32_t length = keys % 5 == 0   ? 0
                                 : keys % 7 == 0 ? 2'100'000
                                                 : 8 + static_cast<std::uint32_t>(keys) * 37U % 40000U;
    entries.push_back({code, length});
    places.emplace_back(code, FaceLocation{kId, offset, length});
    offset += length;
    if (++keys % 101 == 0) end();
  }
  if (!entries.empty()) end();

  const Bytes index = *builder.build(rows, std::string(20000, 'p'), {});
  const auto root = decodeIndexRoot(ByteView(index).first(kIndexFrontBytes));
  ASSERT_TRUE(root) << root.error().message;
  EXPECT_EQ(root->keys, codes.size());
  EXPECT_EQ(root->blocks_offset, 32768U) << "parameters longer than the root's 16 KiB move the blocks";
  EXPECT_GT(root->blocks, 3U);
  EXPECT_EQ(*decodePackRows(*root, ByteView(index).subspan(root->rowsOffset())), rows);
  EXPECT_TRUE(root->fill.empty()) << "it lies behind the parameters";
  const auto whole = decodeIndexRoot(ByteView(index).first(root->frontBytes()));
  ASSERT_TRUE(whole) << whole.error().message;
  ASSERT_EQ(whole->fill.size(), root->blocks);
  const auto blockOf = [&](std::uint64_t code) {
    const std::uint64_t number = blockOfCode(*root, code);
    const ByteView all = ByteView(index).subspan(root->blockOffset(number), root->block_bytes);
    const ByteView read = all.first(whole->bytesToRead(number));
    EXPECT_EQ(decodeIndexBlock(*root, number, all)->keys(), decodeIndexBlock(*root, number, read)->keys());
    return *decodeIndexBlock(*root, number, read);
  };
  for (std::size_t i = 0; i < places.size(); i += 13) {
    const auto found = blockOf(places[i].first).find(places[i].first);
    ASSERT_TRUE(found) << i;
    EXPECT_EQ(found->pack, places[i].second.pack) << i;
    EXPECT_EQ(found->length, places[i].second.length) << i;
    EXPECT_TRUE(found->length == 0 || found->offset == places[i].second.offset) << i;
    for (const std::uint64_t other : {std::uint64_t{1}, kFace, 8 * kFace}) {
      const std::uint64_t beside = places[i].first ^ other;
      EXPECT_EQ(blockOf(beside).find(beside).has_value(), codes.contains(beside)) << i;
    }
  }
}

TEST(PackFormat, aTruncatedOrChangedPackIsRefused) {
  const Bytes pack = encodePack(kEntries, workedValues());
  for (std::size_t size = 0; size < pack.size(); ++size) EXPECT_FALSE(decodePack(ByteView(pack).first(size))) << size;
  for (std::size_t i = 0; i < pack.size(); ++i) {
    if (i >= 64 && i < 159) continue;  // values have checksums of their own
    Bytes flipped = pack;
    flipped[i] ^= 0x10U;
    EXPECT_FALSE(decodePack(flipped)) << i;
  }
  EXPECT_EQ(decodePack(withHeader(pack, 64, 8, std::uint32_t{1})).error().code, ErrorCode::kVersion);
  for (const std::size_t field : {16U, 24U, 32U, 40U, 48U})
    EXPECT_FALSE(decodePack(withHeader(pack, 64, field, ~std::uint64_t{0}))) << field;
}

TEST(PackFormat, anInvalidIndexIsRefused) {
  const Bytes index = workedIndex(encodePack(kEntries, workedValues()));
  const Bytes front(index.begin(), index.begin() + kIndexFrontBytes);
  for (std::size_t size = 0; size < 128; ++size) EXPECT_FALSE(decodeIndexRoot(ByteView(front).first(size))) << size;
  for (std::size_t i = 0; i < 128; ++i) {
    Bytes flipped = front;
    flipped[i] ^= 1U;
    EXPECT_FALSE(decodeIndexRoot(flipped)) << i;
  }
  for (const std::uint64_t value : {std::uint64_t{0}, std::uint64_t{3}, std::uint64_t{1} << 33, ~std::uint64_t{0}})
    for (const std::size_t field : {16U, 64U, 72U, 80U})
      EXPECT_FALSE(decodeIndexRoot(withHeader(front, 128, field, value))) << field << " " << value;
  for (const std::uint32_t value : {0U, 1U, 5000U, 1U << 20})
    EXPECT_FALSE(decodeIndexRoot(withHeader(front, 128, 88, value))) << "block bytes " << value;
  EXPECT_FALSE(decodeIndexRoot(withHeader(front, 128, 92, 63U)));
  EXPECT_FALSE(decodeIndexRoot(withHeader(front, 128, 92, 16U))) << "a run of whole faces would span blocks";
  EXPECT_EQ(decodeIndexRoot(withHeader(front, 128, 8, 2U)).error().code, ErrorCode::kVersion);
  for (const std::uint32_t value : {0U, 2U, ~0U})
    EXPECT_FALSE(decodeIndexRoot(withHeader(front, 128, 108, value))) << "blocks that are told of " << value;
  Bytes wrong = front;
  wrong[130] ^= 1U;
  EXPECT_FALSE(decodeIndexRoot(wrong)) << "how full the block is";
  EXPECT_TRUE(decodeIndexRoot(ByteView(wrong).first(130))) << "which a shorter front does not tell";
}

/// The entries of a grid of so many points along each side, each of which has so many tiles that take a run each.
std::vector<PackEntry> entriesOfGrid(std::uint32_t side, std::uint32_t runs) {
  std::vector<PackEntry> entries;
  for (std::uint32_t x = 0; x < side; ++x)
    for (std::uint32_t y = 0; y < side; ++y)
      for (std::uint32_t z = 0; z < side; ++z)
        for (std::uint32_t run = 0; run < runs; ++run)
          entries.push_back({FaceKey{x, y, z, 0, 64 * run + 1}.code(), 300});
  std::sort(entries.begin(), entries.end(), [](const PackEntry& a, const PackEntry& b) { return a.code < b.code; });
  return entries;
}

struct GridIndex {
  std::vector<PackEntry> entries;
  Bytes bytes;
  IndexRoot root;
};

/// The index of packs that hold entriesOfGrid().
GridIndex indexOfGrid(std::uint32_t side, std::uint32_t runs) {
  const std::vector<PackEntry> entries = entriesOfGrid(side, runs);
  IndexBuilder builder;
  std::vector<PackRow> rows;
  for (std::size_t at = 0; at < entries.size(); at += 200'000) {
    const auto pack = std::span(entries).subspan(at, std::min<std::size_t>(200'000, entries.size() - at));
    builder.addPack(pack);
    rows.push_back({kId, kPackHeaderBytes, pack.front().code, pack.back().code, pack.size()});
  }
  Bytes bytes = *builder.build(rows, "{}", {});
  const IndexRoot root = *decodeIndexRoot(bytes);
  return {entries, std::move(bytes), root};
}

TEST(PackFormat, anIndexOfTooManyBlocksDoesNotTellHowFullTheyAre) {
  const auto [entries, index, root] = indexOfGrid(40, 10);
  EXPECT_GT(root.blocks, 4096U);
  EXPECT_EQ(root.frontBytes(), 130U);
  EXPECT_TRUE(root.fill.empty());
  EXPECT_EQ(root.bytesToRead(7), root.block_bytes);
  const std::uint64_t number = blockOfCode(root, entries.front().code);
  const auto block =
      decodeIndexBlock(root, number, ByteView(index).subspan(root.blockOffset(number), root.bytesToRead(number)));
  ASSERT_TRUE(block) << block.error().message;
  EXPECT_TRUE(block->find(entries.front().code));
}

// Neighbourhoods of 4,060 bytes: of blocks of 4,096 there would have to be so many that no two of them meet.
TEST(PackFormat, neighbourhoodsThatAlmostFillABlockTakeLargerOnes) {
  const auto [entries, index, root] = indexOfGrid(20, 21);
  EXPECT_GT(root.block_bytes, 4096U);
  EXPECT_LT(index.size(), 17U * 24U * entries.size()) << "runs have 24 bytes, and at most 16 times that is room";
}

TEST(PackFormat, anInvalidBlockIsRefused) {
  const Bytes index = workedIndex(encodePack(kEntries, workedValues()));
  const auto root = *decodeIndexRoot(index);
  const Bytes block(index.begin() + 16384, index.begin() + 32768);
  constexpr std::uint32_t kUsed = 56;
  const auto refused = [&](std::size_t offset, std::uint8_t value) {
    Bytes changed = block;
    changed[offset] = value;
    const std::uint32_t crc = base::crc32c(ByteView(changed).first(kUsed).subspan(4));
    std::memcpy(changed.data(), &crc, sizeof(crc));
    const auto decoded = decodeIndexBlock(root, 0, changed);
    return !decoded && decoded.error().message.find("block 0 of the index") != std::string::npos;
  };
  EXPECT_FALSE(refused(13, block[13])) << "nothing is changed";
  EXPECT_TRUE(refused(9, 0x80)) << "packs beyond its end";
  EXPECT_TRUE(refused(10, 2)) << "a second run of zeros";
  EXPECT_TRUE(refused(10, 0)) << "bytes that belong to no run";
  EXPECT_TRUE(refused(28, 1)) << "a pack that is not named";
  EXPECT_TRUE(refused(30 + 6, 0x80)) << "a cell beyond the grid";
  EXPECT_TRUE(refused(30 + 8, 0)) << "no face";
  EXPECT_TRUE(refused(30 + 8, 0x7f)) << "a seventh direction";
  EXPECT_TRUE(refused(30 + 16, 0)) << "a value within the pack's header";
  EXPECT_TRUE(refused(30 + 19, 0xff)) << "a value beyond the largest pack";
  EXPECT_TRUE(refused(30 + 20, 7)) << "a value of 7 bytes";
  EXPECT_TRUE(refused(30 + 25, 0x80)) << "a varint longer than needed";
  EXPECT_TRUE(refused(1000, 1)) << "something behind the runs";
  EXPECT_TRUE(refused(5, 0x7f)) << "more bytes than a block has";
  for (std::size_t size = 0; size < kUsed; ++size)
    EXPECT_FALSE(decodeIndexBlock(root, 0, ByteView(block).first(size))) << size;
  EXPECT_TRUE(decodeIndexBlock(root, 0, ByteView(block).first(kUsed)));
  IndexRoot larger = root;
  larger.blocks = 3;
  const std::uint64_t other = (blockOfCode(larger, 0) + 1) % 3;
  EXPECT_FALSE(decodeIndexBlock(larger, other, block)) << "a run of another block";
}

}  // namespace
}  // namespace repository
