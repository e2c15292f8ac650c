#include "lod/pmr/format.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "base/crc32c.h"
#include "lod/morton.h"
#include "tests/support/made_pmr.h"

namespace lod::pmr {
namespace {

const support::MadePmr& made() {
  static const support::MadePmr file = support::madePmr(128, true, 700);
  return file;
}

base::Bytes tableOf(const support::MadePmr& file) {
  const auto begin = file.file.begin() + kHeaderBytes;
  return {begin, begin + file.header.table_bytes};
}

void expectEqual(const Header& a, const Header& b) {
  EXPECT_EQ(headerBytes(a), headerBytes(b));
}

/// Seals changed bytes again.
void seal(base::Bytes& bytes) {
  const std::uint32_t crc = base::crc32c(base::ByteView(bytes).first(bytes.size() - sizeof(crc)));
  std::memcpy(bytes.data() + bytes.size() - sizeof(crc), &crc, sizeof(crc));
}

TEST(PmrFormatTest, headersReturn) {
  Header header = made().header;
  for (const bool colors : {false, true})
    for (const bool oriented : {false, true}) {
      header.colors = colors;
      header.oriented = oriented;
      const base::Bytes bytes = headerBytes(header);
      ASSERT_EQ(bytes.size(), kHeaderBytes);
      const auto read = readHeader(bytes);
      ASSERT_TRUE(read) << read.error().message;
      expectEqual(*read, header);
      EXPECT_EQ(read->colors, colors);
      EXPECT_EQ(read->oriented, oriented);
    }
}

TEST(PmrFormatTest, damagedAndForeignHeadersAreRefused) {
  const base::Bytes bytes = headerBytes(made().header);
  for (std::size_t length = 0; length < bytes.size(); ++length)
    EXPECT_FALSE(readHeader(base::ByteView(bytes).first(length)));
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    base::Bytes spoilt = bytes;
    spoilt[at] ^= 4;
    EXPECT_FALSE(readHeader(spoilt)) << "byte " << at;
  }
  for (const std::uint8_t version : {1, 3}) {
    base::Bytes other = bytes;
    other[8] = version;
    EXPECT_EQ(readHeader(other).error().code, base::ErrorCode::kVersion);
  }
}

TEST(PmrFormatTest, headersThatContradictThemselvesAreRefused) {
  const auto refused = [](const auto& change) {
    Header header = made().header;
    change(header);
    EXPECT_FALSE(readHeader(headerBytes(header)));
  };
  refused([](Header& h) { h.leaves = 0; });
  refused([](Header& h) { h.points = h.leaves - 1; });
  refused([](Header& h) { h.points = std::uint64_t{h.leaves} * kMaxLeafPoints + 1; });
  refused([](Header& h) { h.table_bytes = kMinLeafBytes * h.leaves - 1; });
  refused([](Header& h) { h.table_bytes = static_cast<std::uint32_t>(h.file_bytes); });
  refused([](Header& h) { h.base_bytes = h.file_bytes; });
  refused([](Header& h) { h.file_bytes = std::uint64_t{1} << 48; });
  refused([](Header& h) { h.file_bytes = 100; });
  refused([](Header& h) { h.lattice.step = 0.0; });
  refused([](Header& h) { h.lattice.step = 1e300; });
  refused([](Header& h) { h.lattice.origin.y = std::numeric_limits<double>::quiet_NaN(); });
  refused([](Header& h) { h.bounds.radius = -1.0F; });
  refused([](Header& h) { h.bounds.center.x = std::numeric_limits<float>::infinity(); });
  base::Bytes flagged = headerBytes(made().header);
  flagged[12] |= 4;
  seal(flagged);
  EXPECT_FALSE(readHeader(flagged));
  base::Bytes padded = headerBytes(made().header);
  padded[kHeaderBytes - 5] = 1;
  seal(padded);
  EXPECT_FALSE(readHeader(padded));
}

TEST(PmrFormatTest, tablesReturnWithBoxesThatHoldTheOldOnesAndRoundedRadii) {
  const std::vector<Leaf>& leaves = made().leaves;
  std::mt19937 random(6);
  std::vector<Leaf> changed = leaves;
  const auto last = static_cast<std::int32_t>((1 << kPositionBits) - 1);
  for (Leaf& leaf : changed) {
    leaf.box = {};
    for (int i = 0; i < 2; ++i) {
      const auto place = [&] { return static_cast<std::int32_t>(random() % (std::uint32_t(last) + 1)); };
      leaf.box.add(made().header.lattice.position(glm::ivec3(place(), place(), place())));
    }
    for (LevelRow& row : leaf.levels)
      row.radius = random() % 5 == 0 ? 0.0F : std::exp2(static_cast<float>(random() % 20) - 18.3F);
  }
  Header header = made().header;
  const base::Bytes table = tableBytes(changed, header.lattice);
  header.table_bytes = static_cast<std::uint32_t>(table.size());
  placeChunks(header, changed);
  const auto read = readTable(header, table);
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->size(), changed.size());
  for (std::size_t i = 0; i < changed.size(); ++i) {
    const Leaf &a = changed[i], &b = (*read)[i];
    EXPECT_EQ(a.code, b.code);
    EXPECT_EQ(a.depth, b.depth);
    EXPECT_TRUE(b.box.contains(a.box.min) && b.box.contains(a.box.max));
    const auto edge = static_cast<float>(header.lattice.step * std::exp2(double(kPositionBits - a.depth)));
    EXPECT_LE(b.box.longest(), a.box.longest() + edge / 100.0F);
    for (std::uint32_t l = 0; l < kLevels; ++l) {
      const LevelRow &x = a.levels[l], &y = b.levels[l];
      EXPECT_EQ(std::tie(x.points, x.foreign, x.triangles, x.point_bytes, x.triangle_bytes),
                std::tie(y.points, y.foreign, y.triangles, y.point_bytes, y.triangle_bytes));
      EXPECT_EQ(std::tie(x.point_offset, x.triangle_offset), std::tie(y.point_offset, y.triangle_offset));
      EXPECT_NEAR(x.radius, y.radius, 0.012F * x.radius);
    }
  }
  EXPECT_EQ(tableBytes(*read, header.lattice), table) << "a table that was read is written as it was";
}

TEST(PmrFormatTest, tablesAreShort) {
  EXPECT_LT(made().header.table_bytes, 90 * made().header.leaves);
}

TEST(PmrFormatTest, chunksLieOneBehindTheOther) {
  const Header& header = made().header;
  const auto& leaves = made().leaves;
  ASSERT_GT(leaves.size(), kGroupLeaves + 3) << "more than one group, the last one short";
  ASSERT_NE(leaves.size() % kGroupLeaves, 0U);
  std::uint64_t end = kHeaderBytes + header.table_bytes;
  for (const Leaf& leaf : leaves) {
    const LevelRow& row = leaf.levels[kCoarsest];
    EXPECT_EQ(row.point_offset, end);
    EXPECT_EQ(row.triangle_offset, end + row.point_bytes);
    end = row.triangle_offset + row.triangle_bytes;
  }
  EXPECT_EQ(end, kHeaderBytes + header.table_bytes + header.base_bytes);
  for (std::size_t first = 0; first < leaves.size(); first += kGroupLeaves) {
    const auto group = std::span(leaves).subspan(first, std::min<std::size_t>(kGroupLeaves, leaves.size() - first));
    for (std::uint32_t level = kCoarsest; level-- > 0;) {
      for (const Leaf& leaf : group) {
        EXPECT_EQ(leaf.levels[level].point_offset, end);
        end += leaf.levels[level].point_bytes;
      }
    }
    for (std::uint32_t level = kCoarsest; level-- > 0;) {
      for (const Leaf& leaf : group) {
        EXPECT_EQ(leaf.levels[level].triangle_offset, end);
        end += leaf.levels[level].triangle_bytes;
      }
    }
  }
  EXPECT_EQ(end, header.file_bytes);
}

TEST(PmrFormatTest, eachChunkHasOnePlace) {
  for (const std::uint32_t leaves : {0U, 1U, 31U, 32U, 33U, 100U}) {
    const ChunkOrder order(leaves);
    ASSERT_EQ(order.chunks(), std::uint64_t{leaves} * kLeafChunks);
    std::vector<bool> seen(order.chunks(), false);
    for (std::uint64_t place = 0; place < order.chunks(); ++place) {
      const ChunkId id = order.at(place);
      ASSERT_LT(id.leaf, leaves);
      ASSERT_LT(id.chunk, kLeafChunks);
      EXPECT_EQ(order.placeOf(id), place);
      EXPECT_EQ(id.chunk % kLevels == kCoarsest, place < order.baseChunks());
      EXPECT_FALSE(seen[id.leaf * kLeafChunks + id.chunk]);
      seen[id.leaf * kLeafChunks + id.chunk] = true;
    }
  }
}

TEST(PmrFormatTest, damagedTablesAreRefused) {
  const base::Bytes table = tableOf(made());
  EXPECT_TRUE(readTable(made().header, table));
  for (std::size_t length = 0; length < table.size(); length += 7)
    EXPECT_FALSE(readTable(made().header, base::ByteView(table).first(length)));
  for (std::size_t at = 0; at < table.size(); at += 3) {
    base::Bytes spoilt = table;
    spoilt[at] ^= 0x11;
    EXPECT_FALSE(readTable(made().header, spoilt)) << "byte " << at;
    if (at >= table.size() - 4) continue;
    // A box may be another now, but the sums are right where the table is taken.
    seal(spoilt);
    if (const auto read = readTable(made().header, spoilt)) {
      std::uint64_t points = 0;
      for (const Leaf& leaf : *read) points += leaf.pointsAt(0);
      EXPECT_EQ(points, made().header.points);
    }
  }
}

TEST(PmrFormatTest, tablesThatContradictTheHeaderAreRefused) {
  const base::Bytes table = tableOf(made());
  const auto refused = [&](const auto& change) {
    Header header = made().header;
    change(header);
    EXPECT_FALSE(readTable(header, table));
  };
  refused([](Header& h) { --h.points; });
  refused([](Header& h) { ++h.base_bytes; });
  refused([](Header& h) { ++h.file_bytes; });
  refused([](Header& h) { --h.leaves; });
}

TEST(PmrFormatTest, cellsOfAllDepthsReturn) {
  // The whole lattice as one leaf; its two halves as cells of depth 1 with leaves of the last depth between.
  const auto returns = [](std::vector<Leaf> leaves) {
    Header header = made().header;
    for (Leaf& leaf : leaves) {
      leaf.levels[0].points = 1;
      leaf.levels[0].point_bytes = 30;
      leaf.box.add(header.lattice.position(mortonPoint(leaf.code)));
    }
    header.leaves = static_cast<std::uint32_t>(leaves.size());
    header.points = leaves.size();
    const base::Bytes table = tableBytes(leaves, header.lattice);
    EXPECT_GE(table.size(), kMinLeafBytes * leaves.size());
    header.table_bytes = static_cast<std::uint32_t>(table.size());
    placeChunks(header, leaves);
    const auto read = readTable(header, table);
    ASSERT_TRUE(read) << read.error().message;
    for (std::size_t i = 0; i < leaves.size(); ++i) {
      EXPECT_EQ(leaves[i].code, (*read)[i].code);
      EXPECT_EQ(leaves[i].depth, (*read)[i].depth);
    }
  };
  const auto cell = [](std::uint64_t code, std::uint32_t depth) {
    Leaf leaf;
    leaf.code = code;
    leaf.depth = depth;
    return leaf;
  };
  const std::uint64_t octant = std::uint64_t{1} << 60;
  returns({cell(0, 0)});
  returns({cell(0, 1), cell(octant, kPositionBits), cell(octant + 1, kPositionBits), cell(octant + 8, 20),
           cell(7 * octant, 1)});
  returns({cell(8 * octant - 1, kPositionBits)});
  std::vector<Leaf> many;
  for (std::uint64_t i = 0; i < 300; ++i) many.push_back(cell(3 * octant + i, kPositionBits));
  returns(many);
}

TEST(PmrFormatTest, aLeafCountsItsPointsFromTheCoarsestOn) {
  Leaf leaf;
  for (std::uint32_t l = 0; l < kLevels; ++l) leaf.levels[l].points = 10 + l, leaf.levels[l].foreign = l;
  EXPECT_EQ(leaf.pointsAt(kCoarsest), 20U);
  EXPECT_EQ(leaf.verticesAt(kCoarsest), 30U);
  EXPECT_EQ(leaf.pointsAt(9), 39U);
  EXPECT_EQ(leaf.verticesAt(9), 58U);
  EXPECT_EQ(leaf.pointsAt(0), 165U);
  EXPECT_EQ(leaf.verticesAt(0), 220U);
}

TEST(PmrFormatTest, mortonCodesReturn) {
  std::mt19937 random(2);
  for (int i = 0; i < 1000; ++i) {
    const auto number = [&] { return static_cast<std::int32_t>(random() >> 11); };
    const glm::ivec3 place(number(), number(), number());
    EXPECT_EQ(mortonPoint(mortonCode(place)), place);
  }
  EXPECT_EQ(mortonCode({1, 0, 0}), 1U);
  EXPECT_EQ(mortonCode({0, 1, 0}), 2U);
  EXPECT_EQ(mortonCode({0, 0, 1}), 4U);
  EXPECT_EQ(mortonCode({3, 5, 6}), 0b110'101'011U);
}

}  // namespace
}  // namespace lod::pmr
