#include "lod/texture/format.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>

#include "base/crc32c.h"
#include "tests/lod/texture/texture_testing.h"

namespace lod::texture {
namespace {

using namespace texture_testing;

// docs/formats/texture.md
constexpr std::size_t kHeader = 68, kRow = 28;

// A scene of 9 patches: patch 2 has one page, patch 5 three, of which one has alpha, patch 8 a reduced one.
struct Scene {
  TextureSummary summary{.patches = 9, .pictures = 2, .texels = 12345, .reduced_pages = 1, .typical_error = 0.125F};
  std::vector<PageRecord> records;
  std::vector<Page> pages;

  void add(std::uint32_t patch, Page page) {
    records.push_back({.patch = patch, .texel = 0.5F + static_cast<float>(patch)});
    pages.push_back(std::move(page));
  }
};
Scene exampleScene() {
  Scene scene;
  scene.add(2, makePages(smooth(64, 64), grid({3.0F, 5.0F}, {40.0F, 31.5F}, 2))[0]);
  scene.add(5, makePages(smooth(64, 48), grid({3.0F, 5.0F}, {20.0F, 21.5F}, 1))[0]);
  base::Image clear = smooth(64, 48, 4);
  scene.add(5, makePages(clear, grid({0.0F, 0.0F}, {64.0F, 48.0F}, 3))[0]);
  scene.add(5, makePages(smooth(64, 48), grid({30.0F, 5.0F}, {40.0F, 41.5F}, 1))[0]);
  scene.add(8, makePages(smooth(200, 48), grid({0.0F, 0.0F}, {200.0F, 40.0F}, 2), 64)[0]);
  return scene;
}

class TextureFormat : public ::testing::Test {
 protected:
  TextureFormat() : path_(::testing::TempDir() + "texture_format_" + std::to_string(::getpid()) + ".lgt") {}
  ~TextureFormat() override { std::filesystem::remove(path_); }

  base::Result<void> write(const Scene& scene) {
    std::vector<PageRecord> records = scene.records;
    for (std::size_t i = 0; i < records.size(); ++i) {
      // A page that cannot be encoded has the record of one that can.
      const auto encoded = encodePage(scene.pages[i]);
      EXPECT_TRUE(describePage(encoded ? *encoded : *encodePage(scene.pages[0]), records[i]));
    }
    return writeTextureFile(path_, scene.summary, records, [&](std::size_t i) { return encodePage(scene.pages[i]); });
  }
  base::Bytes written(const Scene& scene) {
    const auto result = write(scene);
    EXPECT_TRUE(result) << result.error().message;
    return *base::readFile(path_);
  }
  base::Result<TextureFile> opened(const base::Bytes& bytes) {
    std::ofstream(path_, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    return TextureFile::open(path_);
  }
  void expectFault(const base::Bytes& bytes, const std::string& words) {
    const auto file = opened(bytes);
    ASSERT_FALSE(file) << words;
    EXPECT_NE(file.error().message.find(words), std::string::npos) << file.error().message;
    EXPECT_EQ(file.error().message.find(path_), 0U);
  }
  std::string path_;
};

// Returns the bytes with both checksums right.
base::Bytes sealed(base::Bytes bytes) {
  std::uint32_t pages = 0;
  std::memcpy(&pages, bytes.data() + 40, 4);
  if (kHeader + kRow * pages <= bytes.size()) {
    const std::uint32_t table = base::crc32c(base::ByteView(bytes).subspan(kHeader, kRow * pages));
    std::memcpy(bytes.data() + 60, &table, 4);
  }
  const std::uint32_t header = base::crc32c(base::ByteView(bytes).first(64));
  std::memcpy(bytes.data() + 64, &header, 4);
  return bytes;
}
template <class T>
base::Bytes withField(base::Bytes bytes, std::size_t offset, T value) {
  std::memcpy(bytes.data() + offset, &value, sizeof(value));
  return sealed(std::move(bytes));
}

TEST_F(TextureFormat, readsBackWhatWasWritten) {
  const Scene scene = exampleScene();
  written(scene);
  const auto file = TextureFile::open(path_);
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(file->path(), path_);
  EXPECT_EQ(file->fileBytes(), std::filesystem::file_size(path_));
  EXPECT_EQ(file->summary().patches, 9U);
  EXPECT_EQ(file->summary().pictures, 2U);
  EXPECT_EQ(file->summary().texels, 12345U);
  EXPECT_EQ(file->summary().triangles, 8U + 2 + 18 + 2 + 8);
  EXPECT_EQ(file->summary().reduced_pages, 1U);
  EXPECT_EQ(file->summary().typical_error, 0.125F);
  ASSERT_EQ(file->pages().size(), 5U);
  for (std::size_t i = 0; i < 5; ++i) {
    const PageRecord& row = file->pages()[i];
    const Page& page = scene.pages[i];
    EXPECT_EQ(row.patch, scene.records[i].patch);
    EXPECT_EQ(row.texel, scene.records[i].texel);
    EXPECT_EQ(row.width, page.image.width);
    EXPECT_EQ(row.height, page.image.height);
    EXPECT_EQ(row.levels, page.levels);
    EXPECT_EQ(row.alpha, i == 2);
    EXPECT_EQ(row.triangles, page.triangles.size());
    const auto back = file->page(row);
    ASSERT_TRUE(back) << back.error().message;
    EXPECT_EQ(back->triangles, page.triangles);
    EXPECT_EQ(back->scale, page.scale);
    EXPECT_EQ(*file->pageBytes(row), *encodePage(page));
  }
  EXPECT_EQ(file->verify(), std::vector<std::string>{});
}

TEST_F(TextureFormat, aPatchFindsItsPages) {
  written(exampleScene());
  const auto file = TextureFile::open(path_);
  ASSERT_TRUE(file);
  const std::vector<std::size_t> counts{0, 0, 1, 0, 0, 3, 0, 0, 1, 0};
  for (std::uint32_t patch = 0; patch < counts.size(); ++patch)
    EXPECT_EQ(file->pagesOf(patch).size(), counts[patch]) << patch;
  EXPECT_EQ(file->pagesOf(5).data(), file->pages().data() + 1);
}

TEST_F(TextureFormat, aSceneMayHaveNoPages) {
  Scene scene;
  scene.summary.reduced_pages = 0;
  EXPECT_EQ(written(scene).size(), kHeader);
  const auto file = TextureFile::open(path_);
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_TRUE(file->pagesOf(0).empty());
}

TEST_F(TextureFormat, everyCutIsRefusedByName) {
  const base::Bytes bytes = written(exampleScene());
  for (std::size_t length = bytes.size(); length-- > 0;) {
    std::filesystem::resize_file(path_, length);
    const auto file = TextureFile::open(path_);
    ASSERT_FALSE(file) << length;
    ASSERT_EQ(file.error().message.find(path_), 0U) << file.error().message;
  }
  base::Bytes longer = bytes;
  longer.push_back(0);
  expectFault(longer, "its header says");
}

TEST_F(TextureFormat, aFileThatIsCutWhileItIsOpenGivesAnError) {
  written(exampleScene());
  const auto file = TextureFile::open(path_);
  ASSERT_TRUE(file);
  std::filesystem::resize_file(path_, file->fileBytes() - 10);
  EXPECT_TRUE(file->page(file->pages()[0]));
  const auto last = file->page(file->pages()[4]);
  ASSERT_FALSE(last);
  EXPECT_NE(last.error().message.find(path_ + ": ends at byte"), std::string::npos) << last.error().message;
  EXPECT_EQ(file->verify().size(), 1U);
}

TEST_F(TextureFormat, everyFlippedBitInHeaderOrTableIsNoticedOnOpening) {
  base::Bytes bytes = written(exampleScene());
  for (std::size_t bit = 0; bit < (kHeader + 5 * kRow) * 8; bit += bit < kHeader * 8 ? 1 : 7) {
    bytes[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
    EXPECT_FALSE(opened(bytes)) << bit;
    bytes[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
  }
}

TEST_F(TextureFormat, everyFlippedByteOfAPageIsFoundByVerify) {
  base::Bytes bytes = written(exampleScene());
  for (std::size_t at = kHeader + 5 * kRow; at < bytes.size(); at += 29) {
    bytes[at] ^= 0x10;
    const auto file = opened(bytes);
    ASSERT_TRUE(file);
    ASSERT_EQ(file->verify().size(), 1U) << at;
    bytes[at] ^= 0x10;
  }
}

TEST_F(TextureFormat, pagesThatStandInEachOthersPlaceAreFound) {
  Scene scene = exampleScene();
  std::vector<base::Bytes> encoded;
  for (const Page& page : scene.pages) encoded.push_back(*encodePage(page));
  const base::Bytes bytes = written(scene);
  const std::size_t first = kHeader + 5 * kRow;
  base::Bytes swapped(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(first));
  for (const std::size_t i : {1U, 0U, 2U, 3U, 4U}) swapped.insert(swapped.end(), encoded[i].begin(), encoded[i].end());
  // The table says the lengths of the pages as they stand there now, and all else of those that should.
  std::uint64_t offset = first;
  for (std::size_t i = 0; i < 2; ++i) {
    const auto length = static_cast<std::uint32_t>(encoded[1 - i].size());
    std::memcpy(&swapped[kHeader + kRow * i + 4], &length, 4);
    std::memcpy(&swapped[kHeader + kRow * i + 8], &offset, 8);
    offset += length;
  }
  const auto file = opened(sealed(swapped));
  ASSERT_TRUE(file) << file.error().message;
  const auto faults = file->verify();
  ASSERT_EQ(faults.size(), 2U);
  EXPECT_NE(faults[0].find("not as the table says"), std::string::npos);
}

TEST_F(TextureFormat, aWrongFileOrVersionIsNamed) {
  const base::Bytes bytes = written(exampleScene());
  expectFault(base::Bytes(500, 'x'), "not a texture.lgt");
  expectFault({}, "not a texture.lgt");
  const auto newer = opened(withField<std::uint32_t>(bytes, 8, 2));
  ASSERT_FALSE(newer);
  EXPECT_EQ(newer.error().code, base::ErrorCode::kVersion);
  const auto missing = TextureFile::open(path_ + ".none");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, base::ErrorCode::kNotFound);
}

TEST_F(TextureFormat, eachWrongNumberIsNamed) {
  const base::Bytes bytes = written(exampleScene());
  const float nan = std::numeric_limits<float>::quiet_NaN();
  expectFault(withField<std::uint32_t>(bytes, 12, 72), "72 bytes");
  expectFault(withField<std::uint64_t>(bytes, 16, bytes.size() + 1), "its header says");
  expectFault(withField<std::uint64_t>(bytes, 32, 37), "another number of triangles");
  expectFault(withField<std::uint32_t>(bytes, 40, 4), "page 0: it does not begin");
  expectFault(withField<std::uint32_t>(bytes, 40, 0xFFFFFFFF), "would not fit");
  expectFault(withField<std::uint32_t>(bytes, 44, 8), "page 4: its patch");
  expectFault(withField<std::uint32_t>(bytes, 52, 6), "reduced pages");
  expectFault(withField(bytes, 56, 1.5F), "typical error");
  expectFault(withField(bytes, 56, nan), "typical error");
  const std::size_t row = kHeader + 2 * kRow;
  expectFault(withField<std::uint32_t>(bytes, row, 4), "page 2: pages are not sorted");
  expectFault(withField<std::uint32_t>(bytes, row + 4, 1), "page 3: it does not begin");
  expectFault(withField<std::uint64_t>(bytes, row + 8, std::uint64_t{1} << 63), "page 2: it does not begin");
  expectFault(withField(bytes, row + 16, nan), "page 2: its texels");
  expectFault(withField(bytes, row + 16, 0.0F), "page 2: its texels");
  expectFault(withField<std::uint16_t>(bytes, row + 20, 6), "page 2: its sides");
  expectFault(withField<std::uint16_t>(bytes, row + 22, 0), "page 2: its sides");
  expectFault(withField<std::uint16_t>(bytes, row + 24, 0), "page 2: it has no triangles");
  expectFault(withField<std::uint8_t>(bytes, row + 26, 15), "page 2: its levels");
  expectFault(withField<std::uint8_t>(bytes, row + 27, 2), "page 2: unknown flags");
  const auto reduced = opened(withField<std::uint32_t>(bytes, 52, 3));
  ASSERT_TRUE(reduced);
  EXPECT_EQ(reduced->verify().size(), 1U);
}

TEST_F(TextureFormat, nothingAppearsUnlessAllIsWritten) {
  const auto leavesNothing = [&](const Scene& scene, const std::string& words) {
    const auto result = write(scene);
    ASSERT_FALSE(result) << words;
    EXPECT_NE(result.error().message.find(words), std::string::npos) << result.error().message;
    EXPECT_FALSE(std::filesystem::exists(path_));
  };
  Scene scene = exampleScene();
  std::swap(scene.records[0], scene.records[1]);
  leavesNothing(scene, "not sorted");
  scene = exampleScene();
  scene.records[4].patch = 9;
  leavesNothing(scene, "not in the scene");
  scene = exampleScene();
  scene.records[4].texel = -1.0F;
  leavesNothing(scene, "no size");
  scene = exampleScene();
  scene.pages[3].levels = 0;
  leavesNothing(scene, "levels");
  scene = exampleScene();
  scene.summary.typical_error = 2.0F;
  leavesNothing(scene, "typical error");
}

TEST_F(TextureFormat, pagesThatAreNotAsTheirRecordsSayAreNotWritten) {
  const Scene scene = exampleScene();
  std::vector<PageRecord> records = scene.records;
  for (std::size_t i = 0; i < records.size(); ++i) ASSERT_TRUE(describePage(*encodePage(scene.pages[i]), records[i]));
  // Pages 1 and 3 have sizes of their own.
  const auto result = writeTextureFile(path_, scene.summary, records,
                                       [&](std::size_t i) { return encodePage(scene.pages[i == 1 ? 3 : i]); });
  ASSERT_FALSE(result);
  EXPECT_NE(result.error().message.find("page 1"), std::string::npos) << result.error().message;
  EXPECT_FALSE(std::filesystem::exists(path_));
}

TEST_F(TextureFormat, theBytesAreHandedOnInTheirOrder) {
  const Scene scene = exampleScene();
  std::vector<PageRecord> records = scene.records;
  for (std::size_t i = 0; i < records.size(); ++i) ASSERT_TRUE(describePage(*encodePage(scene.pages[i]), records[i]));
  base::Bytes all;
  ASSERT_TRUE(writeTextureFile(
      path_, scene.summary, records, [&](std::size_t i) { return encodePage(scene.pages[i]); },
      [&](const base::Bytes& piece) { all.insert(all.end(), piece.begin(), piece.end()); }));
  EXPECT_EQ(all, *base::readFile(path_));
}

TEST_F(TextureFormat, aRecordOfAnotherFileIsRefused) {
  written(exampleScene());
  const auto file = TextureFile::open(path_);
  ASSERT_TRUE(file);
  PageRecord record = file->pages()[0];
  record.bytes = 0xFFFFFFFF;
  EXPECT_FALSE(file->page(record));
  record.offset = std::numeric_limits<std::uint64_t>::max();
  EXPECT_FALSE(file->page(record));
}

}  // namespace
}  // namespace lod::texture
