// The format of qsplat.lgq: what is written is read back, and damage is found.
#include "lod/qsplat/format.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <tuple>

#include "base/crc32c.h"
#include "lod/qsplat/blocks.h"
#include "lod/qsplat/splat_file.h"
#include "tests/support/decoded_splats.h"
#include "tests/support/random_splats.h"
#include "tests/support/temporary_directory.h"

namespace {

using namespace lod::qsplat;

Header smallHeader() {
  Header header;
  header.file_bytes = 3 * kBlockBytes;
  header.nodes = 101;
  header.leaves = 70;
  header.groups = 32;
  header.pointers = 12;
  header.colors = true;
  header.wide_pointers = true;
  header.levels = 5;
  header.root = {{1.0F, -2.0F, 3.5F}, 0.25F};
  return header;
}

// Returns the file with right checksums, so that damage must be found by other checks.
base::Bytes sealed(base::Bytes bytes) {
  const std::uint32_t crc = base::crc32c(base::ByteView(bytes).first(kPayloadBytes));
  std::memcpy(bytes.data() + kPayloadBytes, &crc, sizeof(crc));
  for (std::size_t at = kBlockBytes; at + kBlockBytes <= bytes.size(); at += kBlockBytes)
    sealBlock(bytes.data() + at, static_cast<std::uint32_t>(at / kBlockBytes));
  return bytes;
}

class QsplatFormat : public ::testing::Test {
 protected:
  base::Bytes tree(bool colors, bool wide, unsigned seed = 3) {
    return support::randomSplats(seed, colors, wide, directory_ / "tree.lgq", 8);
  }
  support::TemporaryDirectory directory_;
};

TEST_F(QsplatFormat, headersComeBack) {
  const Header written = smallHeader();
  const auto read = readHeader(headerBytes(written));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->file_bytes, written.file_bytes);
  EXPECT_EQ(read->nodes, written.nodes);
  EXPECT_EQ(read->leaves, written.leaves);
  EXPECT_EQ(read->groups, written.groups);
  EXPECT_EQ(read->pointers, written.pointers);
  EXPECT_TRUE(read->colors);
  EXPECT_TRUE(read->wide_pointers);
  EXPECT_EQ(read->levels, written.levels);
  EXPECT_EQ(read->root.center, written.root.center);
  EXPECT_EQ(read->root.radius, written.root.radius);
  EXPECT_EQ(read->nodeBytes(), 6U);
  EXPECT_EQ(read->pointerBytes(), 8U);
}

TEST_F(QsplatFormat, aHeaderWithOneBitTurnedOrCutIsRefused) {
  const base::Bytes good = headerBytes(smallHeader());
  for (std::size_t i = 0; i < good.size(); ++i) {
    base::Bytes bad = good;
    bad[i] ^= 1U << (i % 8);
    EXPECT_FALSE(readHeader(bad)) << "byte " << i;
    EXPECT_FALSE(readHeader(base::ByteView(good).first(i))) << "cut to " << i;
  }
}

TEST_F(QsplatFormat, headersThatCannotBeAreRefused) {
  const auto refused = [](auto change) {
    Header header = smallHeader();
    change(header);
    return !readHeader(headerBytes(header));
  };
  EXPECT_TRUE(refused([](Header& h) { h.file_bytes += 1; }));
  EXPECT_TRUE(refused([](Header& h) { h.file_bytes = kBlockBytes; }));
  EXPECT_TRUE(refused([](Header& h) { h.nodes = 0; }));
  EXPECT_TRUE(refused([](Header& h) { h.nodes = ~std::uint64_t{0}; }));
  EXPECT_TRUE(refused([](Header& h) { h.leaves = 102; }));
  EXPECT_TRUE(refused([](Header& h) { h.groups = 31; }));
  EXPECT_TRUE(refused([](Header& h) { h.leaves = 30, h.groups = 72; }));
  EXPECT_TRUE(refused([](Header& h) { h.pointers = 0; }));
  EXPECT_TRUE(refused([](Header& h) { h.pointers = 32; }));
  EXPECT_TRUE(refused([](Header& h) { h.levels = 0; }));
  EXPECT_TRUE(refused([](Header& h) { h.levels = 129; }));
  EXPECT_TRUE(refused([](Header& h) { h.levels = 1; }));
  EXPECT_TRUE(refused([](Header& h) { h.root.radius = 0.0F; }));
  EXPECT_TRUE(refused([](Header& h) { h.root.radius = NAN; }));
  EXPECT_TRUE(refused([](Header& h) { h.root.center.y = INFINITY; }));
}

TEST_F(QsplatFormat, anotherVersionIsNamed) {
  for (const std::uint8_t version : {0, 3, 255}) {
    base::Bytes bytes = headerBytes(smallHeader());
    bytes[8] = version;
    const auto read = readHeader(bytes);
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().code, base::ErrorCode::kVersion);
    EXPECT_NE(read.error().message.find("version " + std::to_string(version)), std::string::npos);
  }
}

TEST_F(QsplatFormat, groupsNeverSpanTwoBlocks) {
  for (std::uint64_t end = kBlockBytes; end < 3 * kBlockBytes; end += 2)
    for (const std::uint32_t bytes : {4U, 8U, 12U, 16U, 20U, 24U, 28U, 32U}) {
      if (end % kBlockBytes > kPayloadBytes) continue;
      const std::uint64_t at = groupPlace(end, bytes);
      ASSERT_GE(at, end);
      ASSERT_LT(at - end, kBlockBytes);
      ASSERT_LE(at % kBlockBytes + bytes, kPayloadBytes);
      ASSERT_TRUE(at == end || at % kBlockBytes == 0);
    }
}

TEST_F(QsplatFormat, blocksKnowTheirPlace) {
  base::Bytes block(kBlockBytes, 7);
  sealBlock(block.data(), 5);
  EXPECT_TRUE(isIntactBlock(block, 5));
  EXPECT_FALSE(isIntactBlock(block, 6));
  block[100] ^= 4;
  EXPECT_FALSE(isIntactBlock(block, 5));
  EXPECT_FALSE(isIntactBlock(base::ByteView(block).first(1000), 5));
}

TEST_F(QsplatFormat, wholeTreesAreFoundWhole) {
  for (const bool colors : {false, true})
    for (const bool wide : {false, true})
      for (unsigned seed = 0; seed < 20; ++seed) {
        const base::Bytes bytes = tree(colors, wide, seed);
        EXPECT_EQ(checkTree(bytes), std::vector<std::string>()) << "seed " << seed;
        EXPECT_EQ(support::decodeSplats(bytes).size(), readHeader(bytes)->nodes);
      }
  const base::Bytes single = support::randomSplats(1, true, false, directory_ / "one.lgq", 1);
  EXPECT_EQ(checkTree(single), std::vector<std::string>());
  EXPECT_EQ(readHeader(single)->nodes, 1U);
}

TEST_F(QsplatFormat, everyTurnedBitIsFoundByAChecksum) {
  const base::Bytes good = tree(true, false);
  for (std::size_t i = 0; i < good.size(); i += 7) {
    base::Bytes bad = good;
    bad[i] ^= 1U << (i % 8);
    EXPECT_FALSE(checkTree(bad).empty()) << "byte " << i;
  }
}

TEST_F(QsplatFormat, structureIsCheckedBehindChecksums) {
  // A flipped bit behind a right checksum may go unnoticed only in codes and colours, whose values nothing else
  // determines.
  for (const bool colors : {false, true}) {
    const base::Bytes good = tree(colors, false);
    const GroupLayout layout(colors, false);
    std::size_t silent = 0;
    std::size_t looked = 0;
    for (std::size_t i = kBlockBytes; i < good.size(); i += 3) {
      if (i % kBlockBytes >= kPayloadBytes) continue;
      base::Bytes bad = good;
      bad[i] ^= 1U << (i % 8);
      ++looked;
      if (!checkTree(sealed(bad)).empty()) continue;
      ++silent;
      const auto a = support::decodeSplats(good);
      const auto b = support::decodeSplats(bad);
      ASSERT_EQ(a.size(), b.size());
      for (std::size_t n = 0; n < a.size(); ++n) {
        ASSERT_EQ(a[n].among_leaves, b[n].among_leaves);
        if (!a[n].among_leaves) {
          ASSERT_EQ(a[n].node.bits >> 29, b[n].node.bits >> 29);
        }
      }
    }
    EXPECT_LT(silent, looked * 9 / 10);
  }
}

TEST_F(QsplatFormat, cutAndGrownFilesAreFound) {
  const base::Bytes good = tree(false, false);
  for (std::size_t size = 0; size < good.size(); size += 111)
    EXPECT_FALSE(checkTree(base::ByteView(good).first(size)).empty());
  base::Bytes longer = good;
  longer.resize(good.size() + kBlockBytes, 0);
  EXPECT_FALSE(checkTree(longer).empty());
  const std::uint64_t length = longer.size();
  std::memcpy(longer.data() + 16, &length, sizeof(length));
  EXPECT_FALSE(checkTree(sealed(longer)).empty());
}

TEST_F(QsplatFormat, openingNamesTheFile) {
  const std::string path = directory_ / "tree.lgq";
  EXPECT_EQ(SplatFile::open(path).error().code, base::ErrorCode::kNotFound);
  const Header header = support::writeRandomSplats(path, 5, true, false);
  const auto file = SplatFile::open(path);
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(file->header().nodes, header.nodes);
  EXPECT_TRUE(file->verify().empty());
  const base::Bytes bytes = *base::readFile(path);
  ASSERT_TRUE(base::writeFileAtomically(path, base::ByteView(bytes).first(bytes.size() - 1)));
  const auto cut = SplatFile::open(path);
  ASSERT_FALSE(cut);
  EXPECT_EQ(cut.error().message.rfind(path, 0), 0U) << cut.error().message;
}

// A file of either form that is cut while it is open: what was read stays, the rest is damaged.
TEST_F(QsplatFormat, blocksOfAFileThatIsCutWhileItIsOpenAreDamaged) {
  const std::string golden = std::string(LUMIGRID_SOURCE_DIR) + "/tests/golden/";
  for (const char* name : {"qsplat_v1.lgq", "qsplat_v2.lgq"})
    for (const bool to_nothing : {false, true}) {
      const std::string path = directory_ / name;
      const base::Bytes bytes = *base::readFile(golden + name);
      ASSERT_TRUE(base::writeFileAtomically(path, bytes));
      const auto file = SplatFile::open(path);
      ASSERT_TRUE(file) << file.error().message;
      const auto whole = openBlocks(file->bytes(), file->header());
      ASSERT_TRUE(whole);
      FileBlocks& blocks = **whole;
      blocks.trackUse();
      ASSERT_NE(blocks.find(1), nullptr);
      const std::uint64_t last = blocks.header().blocks() - 1;
      std::filesystem::resize_file(path, to_nothing ? 0 : bytes.size() / 2);
      EXPECT_NE(blocks.find(1), nullptr);
      for (std::uint64_t b = 1; b <= last; ++b) std::ignore = blocks.find(b);
      EXPECT_EQ(blocks.find(last), nullptr);
      EXPECT_GT(blocks.damagedBlock(), 1U);
      EXPECT_FALSE(file->verify().empty());
    }
}

TEST_F(QsplatFormat, blocksReadFromDiskAreTrimmed) {
  const std::string path = directory_ / "tree.lgq";
  const Header header = support::writeRandomSplats(path, 5, true, false);
  const auto file = SplatFile::open(path);
  ASSERT_TRUE(file);
  const auto opened = openBlocks(file->bytes(), file->header());
  ASSERT_TRUE(opened);
  FileBlocks& blocks = **opened;
  blocks.trackUse();
  for (std::uint64_t b = 1; b < header.blocks(); ++b) EXPECT_NE(blocks.find(b), nullptr);
  EXPECT_EQ(blocks.heldBytes(), (header.blocks() - 1) * kBlockBytes);
  blocks.beginFrame(2);
  ASSERT_NE(blocks.find(1), nullptr);
  blocks.trim(0);
  EXPECT_EQ(blocks.heldBytes(), kBlockBytes) << "the last frame used one";
  EXPECT_NE(blocks.find(header.blocks() - 1), nullptr);
}

// Sums over all nodes of the golden file, as they were when it was written. Centres, radii and colours are compared to
// the bit: every reader decodes the same.
TEST_F(QsplatFormat, goldenFileIsReadAsEver) {
  const std::string path = std::string(LUMIGRID_SOURCE_DIR) + "/tests/golden/qsplat_v1.lgq";
  const auto file = SplatFile::open(path);
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(file->verify(), std::vector<std::string>());
  EXPECT_TRUE(file->header().colors);
  EXPECT_EQ(file->header().leaves, 288U);
  const auto nodes = support::decodeSplats(*base::readFile(path));
  ASSERT_EQ(nodes.size(), file->header().nodes);
  glm::dvec3 centers(0.0);
  glm::dvec3 normals(0.0);
  double radii = 0.0, sines = 0.0;
  std::uint64_t greens = 0;
  for (const support::DecodedNode& node : nodes) {
    centers += glm::dvec3(node.sphere.center);
    radii += static_cast<double>(node.sphere.radius);
    normals += glm::dvec3(normalTable()[node.node.normalCode()]);
    greens += support::decodeColor(node.node.color).g;
    sines += static_cast<double>(std::min(1.0F, coneSines(!node.among_leaves)[node.node.coneField()]));
  }
  EXPECT_EQ(centers, glm::dvec3(-0.31949779624119401, 0.96264469251036644, -0.9982700040563941));
  EXPECT_EQ(radii, 136.32769356667995);
  // Tangents and square roots of normals differ between machines in their last bits.
  const glm::dvec3 golden_normals(-1.3988757329061627, 0.8066740557551384, -0.28824020456522703);
  for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(normals[axis], golden_normals[axis], 1e-4);
  EXPECT_EQ(greens, 50201U);
  EXPECT_EQ(sines, 206.875) << "a cone of any direction counts as 1";
}

TEST_F(QsplatFormat, leavesAmongLeavesHaveFiveBitsForTheirCone) {
  Header header;
  header.file_bytes = 2 * kBlockBytes;
  header.nodes = header.leaves = header.groups = header.levels = 1;
  header.root.radius = 1.0F;
  for (const std::uint32_t cone : {0U, 3U, 4U, 16U, 31U}) {
    base::Bytes file = headerBytes(header);
    file.resize(header.file_bytes, 0);
    const std::uint32_t bits = packLeaf(kWholeParent, 0, cone);
    std::memcpy(&file[kBlockBytes], &bits, sizeof(bits));
    EXPECT_TRUE(checkTree(sealed(file)).empty()) << cone;
  }
}

}  // namespace
