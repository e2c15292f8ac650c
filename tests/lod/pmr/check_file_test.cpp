#include "lod/pmr/check_file.h"

#include <gtest/gtest.h>

#include <functional>

#include "base/crc32c.h"
#include "base/file.h"
#include "lod/pmr/leaf_picture.h"
#include "tests/support/made_pmr.h"

namespace lod::pmr {
namespace {

support::LevelledSurface surface() {
  return support::bumpyTorus(96, 96);
}

std::vector<std::string> faultsOf(const base::Bytes& file) {
  return checkFile(MemoryBytes(file));
}

/// All faults of a file that was made with something changed.
std::string faultOf(const support::PmrMaker::Changes& changes) {
  const support::LevelledSurface torus = surface();
  std::string all;
  for (const std::string& fault : faultsOf(support::PmrMaker(torus, true, 900, changes).make().file)) {
    EXPECT_EQ(fault.find('\n'), std::string::npos);
    all += fault + "\n";
  }
  return all;
}

bool says(const std::string& fault, const std::string& text) {
  return fault.find(text) != std::string::npos;
}

TEST(CheckFileTest, intactFilesHaveNoFaults) {
  EXPECT_EQ(faultsOf(support::madePmr(96, true, 900).file), std::vector<std::string>());
  EXPECT_EQ(faultsOf(support::madePmr(128, false, 12'000).file), std::vector<std::string>());
  EXPECT_EQ(faultsOf(support::madePmr(96, true, 100).file), std::vector<std::string>());
}

// The file was written by version 2; its points must be read for ever as they were then.
TEST(CheckFileTest, theGoldenFileIsReadAsEver) {
  const base::Bytes file = *base::readFile(std::string(LUMIGRID_SOURCE_DIR) + "/tests/golden/pmr_v2.lgm");
  EXPECT_EQ(faultsOf(file), std::vector<std::string>());
  const auto header = readHeader(file);
  ASSERT_TRUE(header);
  EXPECT_TRUE(header->colors && header->oriented);
  EXPECT_EQ(header->points, 680U);
  EXPECT_EQ(header->leaves, 7U);
  const auto leaves = readTable(*header, base::ByteView(file).subspan(kHeaderBytes, header->table_bytes));
  ASSERT_TRUE(leaves);
  std::uint32_t crc = 0;
  std::uint64_t triangles = 0;
  for (const Leaf& leaf : *leaves) {
    std::vector<CodedPoint> points;
    for (std::uint32_t c = kLevels; c-- > 0;) {
      const ChunkPlace place = placeOf(leaf, c);
      const LevelRow& row = leaf.levels[c];
      triangles += row.triangles;
      ASSERT_TRUE(
          decodePoints(base::ByteView(file).subspan(place.offset, place.bytes), row.points, row.foreign, true, points));
    }
    base::ByteWriter out;
    for (const CodedPoint& point : points) {
      out.write(point.place);
      out.write(point.normal);
      out.write(point.color);
    }
    crc = base::crc32c(out.view(), crc);
  }
  EXPECT_EQ(crc, 0x4DD3DA2AU);
  EXPECT_EQ(triangles, 3079U);
}

TEST(CheckFileTest, damageAnywhereIsFound) {
  const base::Bytes intact = support::madePmr(96, true, 900).file;
  for (std::size_t at = 0; at < intact.size(); at += 1 + at / 8) {
    base::Bytes spoilt = intact;
    spoilt[at] ^= 0x20;
    EXPECT_FALSE(faultsOf(spoilt).empty()) << "byte " << at;
  }
  for (const std::size_t length :
       {std::size_t{0}, std::size_t{5}, std::size_t{128}, std::size_t{300}, intact.size() - 1})
    EXPECT_FALSE(faultsOf(base::Bytes(intact.begin(), intact.begin() + static_cast<std::ptrdiff_t>(length))).empty());
}

TEST(CheckFileTest, whatChecksumsDoNotShowIsFound) {
  support::PmrMaker::Changes changes;
  changes.leaf = [](Leaf& leaf) { leaf.levels[3].radius *= 1.1F; };
  EXPECT_TRUE(says(faultOf(changes), "level 3: its mean radius"));

  changes = {};
  changes.leaf = [](Leaf& leaf) { leaf.box.max.x = leaf.box.center().x; };
  EXPECT_TRUE(says(faultOf(changes), "outside its box"));

  changes = {};
  changes.header = [](Header& header) { header.bounds.radius *= 0.9F; };
  EXPECT_TRUE(says(faultOf(changes), "outside the header's bounds"));

  changes = {};
  changes.points = [](std::vector<CodedPoint>& own, std::vector<CodedPoint>&) {
    if (!own.empty()) own.back().place = glm::ivec3((1 << kPositionBits) - 1);
  };
  EXPECT_TRUE(says(faultOf(changes), "outside its cell"));

  changes = {};
  changes.points = [](std::vector<CodedPoint>& own, std::vector<CodedPoint>&) { std::reverse(own.begin(), own.end()); };
  EXPECT_TRUE(says(faultOf(changes), "not in order"));

  changes = {};
  changes.points = [](std::vector<CodedPoint>&, std::vector<CodedPoint>& foreign) {
    if (!foreign.empty()) foreign.front().color.x ^= 1;
  };
  EXPECT_TRUE(says(faultOf(changes), "a foreign point is no point"));

  changes = {};
  changes.corners = [](std::vector<std::uint16_t>& corners, const std::vector<bool>& is_own) {
    std::vector<std::uint16_t> foreign;
    for (std::size_t v = 0; v < is_own.size() && foreign.size() < 3; ++v)
      if (!is_own[v]) foreign.push_back(static_cast<std::uint16_t>(v));
    if (foreign.size() == 3) corners.insert(corners.end(), foreign.begin(), foreign.end());
  };
  EXPECT_TRUE(says(faultOf(changes), "a triangle has no point of the leaf"));

  changes = {};
  changes.corners = [](std::vector<std::uint16_t>& corners, const std::vector<bool>&) { corners.clear(); };
  EXPECT_TRUE(says(faultOf(changes), "a foreign point has no triangle"));
}

TEST(CheckFileTest, aForeignPointOfAFinerLevelIsFound) {
  // Level 0 has all points, so a foreign point of any class is part of level 0, but not of level 10.
  support::LevelledSurface torus = surface();
  for (std::size_t p = 0; p < torus.points.size(); ++p)
    if (torus.classes[p] == kCoarsest && p % 2 == 0) torus.classes[p] = kCoarsest - 1;
  const auto faults = faultsOf(support::PmrMaker(torus, true, 900).make().file);
  ASSERT_FALSE(faults.empty());
  EXPECT_LE(faults.size(), 10U);
}

}  // namespace
}  // namespace lod::pmr
