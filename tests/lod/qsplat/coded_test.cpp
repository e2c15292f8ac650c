// The coded form: each block is restored to the byte, by itself, and any damage is found.
#include <gtest/gtest.h>

#include <random>

#include "lod/qsplat/blocks.h"
#include "lod/qsplat/code_tables.h"
#include "lod/qsplat/splat_file.h"
#include "tests/support/coded_splats.h"
#include "tests/support/random_splats.h"
#include "tests/support/splat_tree.h"
#include "tests/support/temporary_directory.h"
#include "tests/support/test_meshes.h"

namespace {

using namespace lod::qsplat;

/// Files of random codes and of surfaces.
std::vector<base::Bytes> plainFiles() {
  const support::TemporaryDirectory directory;
  std::vector<base::Bytes> files;
  for (const bool colors : {false, true})
    for (const bool wide : {false, true}) {
      files.push_back(support::randomSplats(3, colors, wide, directory / "tree.lgq", 7));
      support::Mesh mesh = support::bumpySphere(40, 80, 0.1F);
      if (colors) mesh.colors.assign(mesh.positions.size(), {200, 100, 50, 255});
      files.push_back(support::splatFile(mesh, wide));
    }
  files.push_back(support::randomSplats(1, true, false, directory / "one.lgq", 1));  // a root alone
  return files;
}

base::Bytes surface() {
  return support::splatFile(support::bumpySphere(60, 120, 0.1F));
}

TEST(QsplatCoded, everyBlockComesBackAsItWas) {
  for (const base::Bytes& plain : plainFiles()) {
    const base::Bytes coded = support::codedSplats(plain);
    const auto header = readHeader(coded);
    ASSERT_TRUE(header) << header.error().message;
    EXPECT_TRUE(header->coded());
    EXPECT_EQ(header->storedBytes(), coded.size());
    EXPECT_EQ(header->file_bytes, plain.size());
    EXPECT_EQ(checkTree(coded), std::vector<std::string>());
    const auto blocks = openBlocks(coded, *header);
    ASSERT_TRUE(blocks) << blocks.error().message;
    for (std::uint64_t b = 1; b < header->blocks(); ++b) {
      const std::uint8_t* block = (*blocks)->find(b);
      ASSERT_NE(block, nullptr) << "block " << b;
      ASSERT_EQ(std::memcmp(block, &plain[b * kBlockBytes], kBlockBytes), 0) << "block " << b;
      EXPECT_LE((*blocks)->storedBytes(b), kMaxCodedBytes);
    }
  }
}

TEST(QsplatCoded, surfacesTakeAboutHalfTheBytes) {
  const base::Bytes plain = surface();
  EXPECT_LT(support::codedSplats(plain).size(), plain.size() * 7 / 10);
}

TEST(QsplatCoded, threadsDoNotChangeTheBytes) {
  const base::Bytes plain = support::splatFile(support::bumpySphere(120, 240, 0.1F));
  const base::Bytes first = support::codedSplats(plain, 1);
  EXPECT_TRUE(support::codedSplats(plain, 3) == first);
}

TEST(QsplatCoded, aBlockIsFoundOnceItsParentsWereAndDecodedWithoutOthers) {
  const base::Bytes plain = surface();
  const base::Bytes coded = support::codedSplats(plain);
  const Header header = *readHeader(coded);
  CodedBlocks blocks(std::make_shared<lod::MemoryBytes>(coded), header, *BlockCoder::fromHeader(coded, header));
  const std::uint64_t last = header.blocks() - 1;
  EXPECT_EQ(blocks.find(last), nullptr) << "nobody has told where it is";
  EXPECT_EQ(blocks.damagedBlock(), 0U);

  // Look up only the blocks on the way to it.
  std::vector<std::uint64_t> chain{last};
  const BlockCoder coder = *BlockCoder::fromHeader(coded, header);
  std::vector<CodedPlace> places(header.blocks());
  places[1] = {header.header_bytes, header.first_block_bytes};
  std::vector<std::uint64_t> parent(header.blocks(), 0);
  base::Bytes block(kBlockBytes);
  for (std::uint64_t b = 1; b <= last; ++b) {
    ChildBlocks children;
    ASSERT_TRUE(
        coder.decode(b, base::ByteView(coded).subspan(places[b].offset, places[b].bytes), block.data(), children));
    forEachChildBlock(children, [&](std::uint64_t number, const CodedPlace& place) {
      if (number > b && parent[number] == 0) parent[number] = b, places[number] = place;
    });
  }
  while (parent[chain.back()] != 0) chain.push_back(parent[chain.back()]);
  ASSERT_LT(chain.size(), 8U);
  for (auto b = chain.rbegin(); b != chain.rend(); ++b) ASSERT_NE(blocks.find(*b), nullptr);
  EXPECT_EQ(std::memcmp(blocks.find(last), &plain[last * kBlockBytes], kBlockBytes), 0);
}

TEST(QsplatCoded, memoryIsGivenBackAndWhatWasDroppedComesAgain) {
  const base::Bytes plain = surface();
  const base::Bytes coded = support::codedSplats(plain);
  const Header header = *readHeader(coded);
  CodedBlocks blocks(std::make_shared<lod::MemoryBytes>(coded), header, *BlockCoder::fromHeader(coded, header));
  blocks.trackUse();
  blocks.beginFrame(1);
  for (std::uint64_t b = 1; b < header.blocks(); ++b) ASSERT_NE(blocks.find(b), nullptr);
  blocks.beginFrame(2);
  const std::uint8_t* kept = blocks.find(header.blocks() - 1);
  blocks.trim(0);
  EXPECT_EQ(blocks.find(header.blocks() - 1), kept) << "the frame's own stay";
  for (std::uint64_t b = 1; b < header.blocks(); ++b)
    ASSERT_EQ(std::memcmp(blocks.find(b), &plain[b * kBlockBytes], kBlockBytes), 0) << b;
}

TEST(QsplatCoded, everyTurnedBitIsFound) {
  const base::Bytes good = support::codedSplats(surface());
  for (std::size_t i = 0; i < good.size(); i += 41) {
    base::Bytes bad = good;
    bad[i] ^= 1U << (i % 8);
    EXPECT_FALSE(checkTree(bad).empty()) << "byte " << i;
  }
  for (std::size_t length = 0; length < good.size(); length += 97)
    EXPECT_FALSE(checkTree(base::ByteView(good).first(length)).empty()) << "cut to " << length;
}

// The places of children are covered, too: whoever requests damaged blocks again must request the right ones.
TEST(QsplatCoded, aBlockFindsEveryTurnedBitOfItsOwn) {
  const base::Bytes coded = support::codedSplats(surface());
  const Header header = *readHeader(coded);
  const BlockCoder coder = *BlockCoder::fromHeader(coded, header);
  const auto first = coded.begin() + header.header_bytes;
  const base::Bytes good(first, first + header.first_block_bytes);
  base::Bytes plain(kBlockBytes);
  ChildBlocks children;
  for (std::size_t bit = 0; bit < 8 * good.size(); ++bit) {
    base::Bytes bad = good;
    bad[bit / 8] ^= 1U << bit % 8;
    EXPECT_FALSE(coder.decode(1, bad, plain.data(), children)) << "bit " << bit;
  }
}

// These headers have a right checksum.
TEST(QsplatCoded, headersThatCannotBeAreRefused) {
  const base::Bytes good = support::codedSplats(surface());
  const auto refused = [&](std::size_t offset, std::uint64_t value, std::size_t bytes) {
    base::Bytes bad = good;
    std::memcpy(bad.data() + offset, &value, bytes);
    return !readHeader(support::sealedHeader(bad, false));
  };
  EXPECT_TRUE(refused(16, good.size() + 1, 8)) << "a length that is no number of blocks";
  EXPECT_TRUE(refused(16, 1024, 8)) << "shorter than its header";
  EXPECT_TRUE(refused(80, std::uint64_t{1} << 50, 8)) << "more blocks than can be in it";
  EXPECT_TRUE(refused(80, 1024, 8)) << "no block";
  EXPECT_TRUE(refused(88, kMinCodedBytes - 1, 4));
  EXPECT_TRUE(refused(88, kMaxCodedBytes + 1, 4));
  for (const std::uint32_t length : {0U, 95U, 96U, kMaxCodedHeaderBytes + 1, 0xFFFFFFFFU}) {
    base::Bytes bad = good;
    std::memcpy(bad.data() + 12, &length, sizeof(length));
    EXPECT_FALSE(readHeader(bad)) << length;
  }
  base::Bytes newer = good;
  newer[8] = 3;
  const auto read = readHeader(newer);
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().code, base::ErrorCode::kVersion);
}

TEST(QsplatCoded, tablesThatAreNoneAreRefused) {
  const base::Bytes good = support::codedSplats(surface());
  const Header header = *readHeader(good);
  // With these bits every level rises beyond the highest.
  base::Bytes bad = good;
  std::fill(bad.begin() + 92, bad.begin() + header.header_bytes - 4, std::uint8_t{0x55});
  bad = support::sealedHeader(bad);
  ASSERT_TRUE(readHeader(bad));
  EXPECT_FALSE(BlockCoder::fromHeader(bad, *readHeader(bad)));
  EXPECT_FALSE(openBlocks(bad, *readHeader(bad)));
}

TEST(QsplatCoded, blocksOfAnyBytesAreDecodedWithoutHarm) {
  const base::Bytes coded = support::codedSplats(surface());
  const Header header = *readHeader(coded);
  const BlockCoder coder = *BlockCoder::fromHeader(coded, header);
  std::mt19937 random(7);
  base::Bytes plain(kBlockBytes);
  ChildBlocks children;
  for (int i = 0; i < 20'000; ++i) {
    base::Bytes bytes(random() % kMaxCodedBytes);
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
    if (bytes.size() > 5) bytes[5] = static_cast<std::uint8_t>(random() % 3);
    EXPECT_FALSE(coder.decode(1, bytes, plain.data(), children));
  }
  const base::ByteView first = base::ByteView(coded).subspan(header.header_bytes, header.first_block_bytes);
  EXPECT_TRUE(coder.decode(1, first, plain.data(), children));
  EXPECT_FALSE(coder.decode(2, first, plain.data(), children)) << "another's place";
}

TEST(QsplatCoded, levelsComeBackAndFrequenciesAddUp) {
  std::mt19937 random(3);
  for (const bool colors : {false, true}) {
    SymbolCounts counts;
    for (auto& context : counts) context.fill(0);
    for (const SymbolKind& kind : kSymbolKinds)
      for (std::uint32_t c = kind.first; c < kind.first + kind.contexts; ++c)
        for (std::uint32_t s = 0;
             s < kind.symbols && (colors || c < kGreenKind.first || c >= kLeafConeKind.first) && c % 5 != 0; ++s)
          counts[c][s] = random() % 3 == 0 ? 0 : std::uint64_t{1} << random() % 40;
    SymbolLevels levels, read;
    levelsFrom(counts, levels);
    const base::Bytes packed = packLevels(levels, colors);
    ASSERT_TRUE(unpackLevels(packed, colors, read));
    EXPECT_EQ(levels, read);
    for (std::size_t i = 0; i < packed.size(); ++i)
      EXPECT_FALSE(unpackLevels(base::ByteView(packed).first(i), colors, read)) << "cut to " << i;

    const CodeTables tables(levels);
    for (const SymbolKind& kind : kSymbolKinds)
      for (std::uint32_t c = kind.first; c < kind.first + kind.contexts; ++c) {
        std::uint32_t end = 0;
        for (std::uint32_t s = 0; s < kind.symbols; ++s) {
          const CodeTables::Range range = tables.range(c, s);
          ASSERT_EQ(range.begin, end);
          ASSERT_TRUE(range.frequency > 0 || counts[c][s] == 0);
          for (; end < range.begin + range.frequency; ++end) {
            ASSERT_EQ(tables.find(c, end).symbol, s);
            ASSERT_EQ(tables.find(c, end).frequency, range.frequency);
          }
        }
        ASSERT_EQ(end, kFrequencySum);
      }
  }
}

TEST(QsplatCoded, tablesThatAreTooLongAreFlattenedFromTheRarestOn) {
  std::mt19937 random(5);
  SymbolCounts counts;
  for (auto& context : counts) context.fill(0);
  for (const SymbolKind& kind : kSymbolKinds)
    for (std::uint32_t c = kind.first; c < kind.first + kind.contexts; ++c)
      for (std::uint32_t s = 0; s < kind.symbols; ++s)
        counts[c][s] = random() % 2 == 0 ? 0 : (c + 1) * (std::uint64_t{1} << random() % 12);
  SymbolLevels levels;
  levelsFrom(counts, levels);
  const std::size_t before = packLevels(levels, true).size();
  const SymbolLevels exact = levels;
  flattenRarest(counts, true, before, levels);
  EXPECT_EQ(levels, exact) << "they fit";
  for (const std::size_t most : {before - 1, std::size_t{4000}, std::size_t{2048}}) {
    ASSERT_LT(most, before);
    flattenRarest(counts, true, most, levels);
    EXPECT_LE(packLevels(levels, true).size(), most);
    for (std::size_t c = 0; c < kContexts; ++c)
      for (std::size_t s = 0; s < kMaxSymbols; ++s)
        if (counts[c][s] > 0) {
          ASSERT_GT(levels[c][s], 0);
        }
  }
}

TEST(QsplatCoded, symbolsComeOutAsTheyWentIn) {
  SymbolCounts counts;
  for (auto& context : counts) context.fill(0);
  for (std::uint32_t s = 0; s < 8; ++s) counts[0][s] = s < 6 ? std::uint64_t{1} << 3 * s : 0;
  SymbolLevels levels;
  levelsFrom(counts, levels);
  const CodeTables tables(levels);
  std::mt19937 random(1);
  std::vector<SymbolWriter::Symbol> symbols;
  for (int i = 0; i < 1000; ++i)
    symbols.push_back({0, static_cast<std::uint8_t>(random() % 50 < 40 ? 5 : random() % 6)});
  base::Bytes bytes;
  ASSERT_TRUE(SymbolWriter::append(tables, symbols, bytes));
  EXPECT_LT(bytes.size(), 450U);
  SymbolReader reader(tables, bytes);
  for (const auto& symbol : symbols) ASSERT_EQ(reader.symbol(symbol.context), symbol.symbol);
  EXPECT_TRUE(reader.endedWell());

  SymbolReader cut(tables, base::ByteView(bytes).first(bytes.size() - 2));
  for (std::size_t i = 0; i < symbols.size(); ++i) cut.symbol(0);
  EXPECT_FALSE(cut.endedWell());
  symbols.push_back({0, 7});  // never comes, as the tables have it
  EXPECT_FALSE(SymbolWriter::append(tables, symbols, bytes));
}

TEST(QsplatCoded, goldenFileIsReadAndWrittenAsEver) {
  const std::string folder = std::string(LUMIGRID_SOURCE_DIR) + "/tests/golden/";
  const auto plain = SplatFile::open(folder + "qsplat_v1.lgq");
  const auto coded = SplatFile::open(folder + "qsplat_v2.lgq");
  ASSERT_TRUE(plain && coded);
  EXPECT_EQ(coded->verify(), std::vector<std::string>());
  const base::Bytes plain_bytes = *base::readFile(folder + "qsplat_v1.lgq");
  const base::Bytes coded_bytes = *base::readFile(folder + "qsplat_v2.lgq");
  EXPECT_TRUE(support::plainSplats(coded_bytes) == plain_bytes);
  EXPECT_TRUE(support::codedSplats(plain_bytes) == coded_bytes);
}

}  // namespace
