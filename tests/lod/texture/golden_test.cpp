// tests/golden/texture_v1.lgt must stay readable. A change of the format gets a new version and a new file beside it.
// Its bytes are not compared, since other versions of libjpeg and zlib may find shorter ones.
// LUMIGRID_WRITE_GOLDEN=1 writes the file anew.
#include <gtest/gtest.h>

#include <cstdlib>

#include "lod/texture/format.h"
#include "tests/lod/texture/texture_testing.h"

namespace lod::texture {
namespace {

using namespace texture_testing;

const std::string kGolden = std::string(LUMIGRID_SOURCE_DIR) + "/tests/golden/texture_v1.lgt";

// Three patches. Patch 1 has a page with a red and a blue square of two triangles each; patch 2 has one of a single
// triangle that is half transparent.
std::vector<Page> goldenPages() {
  base::Image picture(64, 64, 3);
  paint(picture, {4, 4}, {24, 24}, {200, 40, 40});
  paint(picture, {34, 34}, {64, 64}, {40, 40, 200});
  std::vector<PictureTriangle> squares = grid({8.0F, 8.0F}, {20.0F, 20.0F}, 1);
  addGrid(squares, {40.0F, 40.0F}, {60.0F, 52.5F}, 1);
  base::Image clear(64, 64, 4);
  paint(clear, {0, 0}, {64, 64}, {40, 200, 40, 128});
  const std::vector<PictureTriangle> triangle{{7, {glm::vec2(0.0F), glm::vec2(20.0F, 0.0F), glm::vec2(0.0F, 10.0F)}}};
  return {makePages(picture, squares)[0], makePages(clear, triangle)[0]};
}

TEST(TextureGolden, theFileOfVersion1IsReadable) {
  const std::vector<Page> pages = goldenPages();
  if (std::getenv("LUMIGRID_WRITE_GOLDEN") != nullptr) {
    std::vector<PageRecord> records{{.patch = 1, .texel = 0.25F}, {.patch = 2, .texel = 0.5F}};
    for (std::size_t i = 0; i < 2; ++i) ASSERT_TRUE(describePage(*encodePage(pages[i]), records[i]));
    const TextureSummary summary{.patches = 3, .pictures = 2, .texels = 501, .typical_error = 0.125F};
    ASSERT_TRUE(writeTextureFile(kGolden, summary, records, [&](std::size_t i) { return encodePage(pages[i]); }));
  }
  const auto file = TextureFile::open(kGolden);
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(file->verify(), std::vector<std::string>{});
  EXPECT_EQ(file->summary().patches, 3U);
  EXPECT_EQ(file->summary().pictures, 2U);
  EXPECT_EQ(file->summary().texels, 501U);
  EXPECT_EQ(file->summary().triangles, 5U);
  EXPECT_EQ(file->summary().typical_error, 0.125F);
  EXPECT_TRUE(file->pagesOf(0).empty());
  for (std::uint32_t i = 0; i < 2; ++i) {
    ASSERT_EQ(file->pagesOf(i + 1).size(), 1U);
    const PageRecord& row = file->pagesOf(i + 1)[0];
    EXPECT_EQ(row.texel, i == 0 ? 0.25F : 0.5F);
    const auto page = file->page(row);
    ASSERT_TRUE(page) << page.error().message;
    EXPECT_EQ(page->triangles, pages[i].triangles);
    EXPECT_EQ(page->levels, pages[i].levels);
    ASSERT_EQ(page->image.pixels.size(), pages[i].image.pixels.size());
    for (std::size_t k = 0; k < page->image.pixels.size(); ++k)
      ASSERT_NEAR(page->image.pixels[k], pages[i].image.pixels[k], 12) << k;
  }
}

}  // namespace
}  // namespace lod::texture
