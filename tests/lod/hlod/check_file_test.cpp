#include "lod/hlod/check_file.h"

#include <gtest/gtest.h>

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
  changes.header = [](Header& header) { header.bounds.radius *= 0.9F; };
  EXPECT_TRUE(says(faultOf(changes), "outside the header's bounds"));

  support::MadeHlod made = support::madeHlod(1, 8);
  ++made.header.source_triangles;
  const base::Bytes front = headerBytes(made.header);
  std::copy(front.begin(), front.end(), made.file.begin());
  ASSERT_EQ(faultsOf(made.file).size(), 1U);
  EXPECT_TRUE(says(faultsOf(made.file)[0], "contradicts the header"));
}

}  // namespace
}  // namespace lod::hlod
