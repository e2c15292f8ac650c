#include "lod/hlod/check_file.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/crc32c.h"
#include "base/file.h"
#include "tests/support/made_hlod.h"

namespace lod::hlod {
namespace {

std::vector<std::string> faultsOf(const base::Bytes& file) {
  return checkFile(MemoryBytes(file));
}

/// All faults of a file that was made with something changed.
std::string faultOf(const support::HlodMaker::Changes& changes) {
  std::string all;
  for (const std::string& fault : faultsOf(support::HlodMaker(2, 8, true, changes).make().file)) {
    EXPECT_EQ(fault.find('\n'), std::string::npos);
    all += fault + "\n";
  }
  return all;
}

bool says(const std::string& fault, const std::string& text) {
  return fault.find(text) != std::string::npos;
}

TEST(HlodCheckFileTest, intactFilesHaveNoFaults) {
  EXPECT_EQ(faultsOf(support::madeHlod(3, 8, true).file), std::vector<std::string>());
  EXPECT_EQ(faultsOf(support::madeHlod(0, 16, false).file), std::vector<std::string>());
}

// The file was written by version 2; its geometry must be read for ever as it was then.
TEST(HlodCheckFileTest, theGoldenFileIsReadAsEver) {
  const base::Bytes file = *base::readFile(std::string(LUMIGRID_SOURCE_DIR) + "/tests/golden/hlod_v2.lgh");
  EXPECT_EQ(faultsOf(file), std::vector<std::string>());
  const auto header = readHeader(file);
  ASSERT_TRUE(header);
  EXPECT_TRUE(header->colors);
  EXPECT_EQ(header->source_triangles, 512U);
  const auto nodes = readTable(*header, base::ByteView(file).subspan(kHeaderBytes, header->table_bytes));
  ASSERT_TRUE(nodes);
  EXPECT_EQ(nodes->size(), 21U);
  base::ByteWriter out;
  for (const Node& node : *nodes) {
    for (const bool is_caster : {false, true}) {
      if (is_caster && node.isLeaf()) continue;
      const BlockPlace& place = is_caster ? node.caster : node.picture;
      const auto geometry =
          decodeBlock(base::ByteView(file).subspan(place.offset, place.bytes), node, {true, is_caster});
      ASSERT_TRUE(geometry);
      for (const auto* list : {&geometry->vertices, &geometry->points})
        for (const NodeVertex& vertex : *list) out.write(vertex.place), out.write(vertex.color);
      for (const auto* list : {&geometry->triangles, &geometry->edges})
        for (const std::uint32_t vertex : *list) out.u32(vertex);
    }
    for (const float error : {node.error, node.shape_error, node.caster_error})
      out.u32(static_cast<std::uint32_t>(std::lround(1e6F * error)));
  }
  EXPECT_EQ(base::crc32c(out.view()), 0x8AF8248DU);
}

TEST(HlodCheckFileTest, damageAnywhereIsFound) {
  const base::Bytes intact = support::madeHlod(2, 8).file;
  for (std::size_t at = 0; at < intact.size(); at += 1 + at / 8) {
    base::Bytes spoilt = intact;
    spoilt[at] ^= 0x20;
    EXPECT_FALSE(faultsOf(spoilt).empty()) << "byte " << at;
  }
  for (const std::size_t length :
       {std::size_t{0}, std::size_t{5}, std::size_t{128}, std::size_t{300}, intact.size() - 1})
    EXPECT_FALSE(faultsOf(base::Bytes(intact.begin(), intact.begin() + static_cast<std::ptrdiff_t>(length))).empty());
}

TEST(HlodCheckFileTest, whatChecksumsDoNotShowIsFound) {
  support::HlodMaker::Changes changes;
  changes.picture = [](std::uint32_t number, NodeGeometry& picture) {
    if (number == 3) picture.vertices[10].place.z = 0;
  };
  EXPECT_TRUE(says(faultOf(changes), "node 3: picture: a place lies outside the node's box"));

  changes = {};
  changes.picture = [](std::uint32_t number, NodeGeometry& picture) {
    if (number == 2) picture.points[0].place.z = 0;
  };
  EXPECT_TRUE(says(faultOf(changes), "node 2: picture: a place lies outside the node's box"));

  changes = {};
  changes.caster = [](std::uint32_t number, NodeGeometry& caster) {
    if (number == 1) caster.vertices[10].place.z = 0;
  };
  EXPECT_TRUE(says(faultOf(changes), "node 1: caster: a place lies outside the node's box"));

  changes = {};
  changes.picture = [](std::uint32_t number, NodeGeometry& picture) {
    if (number == 9) picture.vertices[picture.triangles[0]].place = picture.vertices[picture.triangles[1]].place;
  };
  EXPECT_TRUE(says(faultOf(changes), "node 9: picture: a triangle has two corners at one place"));

  changes = {};
  changes.header = [](Header& header) { header.low.x += 1 << 18; };
  EXPECT_TRUE(says(faultOf(changes), "node 0: picture: a place lies outside the node's box"));

  support::MadeHlod made = support::madeHlod(1, 8);
  ++made.header.source_triangles;
  const base::Bytes front = headerBytes(made.header);
  std::copy(front.begin(), front.end(), made.file.begin());
  ASSERT_EQ(faultsOf(made.file).size(), 1U);
  EXPECT_TRUE(says(faultsOf(made.file)[0], "contradicts the header"));
}

}  // namespace
}  // namespace lod::hlod
