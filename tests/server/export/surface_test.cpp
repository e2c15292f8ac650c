#include "server/export/surface.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "base/jpeg/jpeg.h"
#include "base/png/png.h"
#include "tests/support/synthetic_hierarchy.h"
#include "tests/support/temporary_directory.h"

namespace {

using server::exports::floatOriginNear;
using server::exports::GlbPrimitive;

/// A hierarchy of one patch that is `size` units long.
lod::patch::Hierarchy lineOf(double size, double step) {
  lod::patch::Hierarchy h;
  h.lattice = {glm::dvec3(-0.5 * size), step};
  h.groups.resize(1);
  h.groups[0].patch_count = 1;
  h.patches.resize(1);
  h.patches[0].box.add(glm::vec3(static_cast<float>(-0.5 * size)));
  h.patches[0].box.add(glm::vec3(static_cast<float>(0.5 * size)));
  return h;
}

TEST(FloatOrigin, isOneForASceneOfFourMillionSteps) {
  const auto h = lineOf(4000.0, 0.001);
  const glm::ivec3 origin = floatOriginNear(h, glm::vec3(0.0F));
  for (const float x : {-1999.0F, -3.5F, 1234.0F, 1999.0F}) EXPECT_EQ(floatOriginNear(h, glm::vec3(x)), origin);
}

TEST(FloatOrigin, leavesFloatsLessThanHalfAStepOff) {
  const double step = 0.0007;
  const auto h = lineOf(100'000.0, step);
  for (const float x : {-50'000.0F, -12'345.6F, 0.0F, 2'222.2F, 50'000.0F}) {
    const int origin = floatOriginNear(h, glm::vec3(x)).x;
    // Half a tile of a million steps lies beyond the place.
    const double steps = std::round((static_cast<double>(x) - h.lattice.origin.x) / step) + 1e6 - origin;
    const auto written = static_cast<double>(static_cast<float>(step * steps));
    EXPECT_NEAR(written, step * steps, 0.5 * step) << x;
  }
}

TEST(MetresPerUnit, knowsBothFeet) {
  base::Scene scene;
  EXPECT_EQ(server::exports::metresPerUnit(scene), 1.0);
  scene.units = "ft";
  EXPECT_EQ(server::exports::metresPerUnit(scene), 0.3048);
  scene.units = "us-ft";
  EXPECT_NEAR(server::exports::metresPerUnit(scene), 0.304800609601219, 1e-15);
}

/// The first leaf has a page, opaque or not, for its first three triangles. Each has corners of its own there.
class TexturedSurface : public testing::Test {
 protected:
  server::exports::ExportScene texturedScene(int channels) {
    const auto made = support::syntheticHierarchy(4, true);
    EXPECT_TRUE(support::writeSynthetic(made, directory_ / "patch.lgp"));
    while (made.hierarchy.patches[leaf_].producer != lod::patch::kNoGroup) ++leaf_;

    lod::texture::Page page;
    page.image = base::Image(16, 8, channels);
    for (std::size_t i = 0; i < page.image.pixels.size(); ++i) page.image.pixels[i] = i % 4 == 3 ? 80 : 200;
    for (std::uint16_t t = 0; t < 3; ++t) {
      const auto x = static_cast<std::uint16_t>(32 * t);
      page.triangles.push_back({t, {glm::u16vec2{x, 0}, glm::u16vec2{x + 16, 0}, glm::u16vec2{x, 64}}});
    }
    lod::texture::PageRecord record;
    record.patch = leaf_;
    record.texel = 0.5F;
    EXPECT_TRUE(lod::texture::describePage(*lod::texture::encodePage(page), record));
    lod::texture::TextureSummary summary;
    summary.patches = static_cast<std::uint32_t>(made.hierarchy.patches.size());
    summary.pictures = 1;
    const auto written = lod::texture::writeTextureFile(directory_ / "texture.lgt", summary, std::span(&record, 1),
                                                        [&](std::size_t) { return lod::texture::encodePage(page); });
    EXPECT_TRUE(written) << written.error().message;

    server::exports::ExportScene scene;
    scene.scene.light.mode = base::LightMode::kUnlit;
    scene.patches = *lod::patch::PatchFile::open(directory_ / "patch.lgp");
    scene.textures = *lod::texture::TextureFile::open(directory_ / "texture.lgt");
    return scene;
  }
  std::vector<GlbPrimitive> primitivesOf(const server::exports::ExportScene& scene) {
    std::vector<GlbPrimitive> primitives;
    const auto added = server::exports::addSurface(
        scene, std::span(&leaf_, 1), glm::ivec3(0),
        [&](GlbPrimitive&& primitive) -> base::Result<void> {
          primitives.push_back(std::move(primitive));
          return {};
        },
        nullptr);
    EXPECT_TRUE(added) << added.error().message;
    return primitives;
  }
  support::TemporaryDirectory directory_;
  std::uint32_t leaf_ = 0;
};

TEST_F(TexturedSurface, hasAPrimitiveForThePageAndOneForTheRest) {
  const auto scene = texturedScene(3);
  const auto primitives = primitivesOf(scene);
  ASSERT_EQ(primitives.size(), 2U);
  const GlbPrimitive &page = primitives[0], &rest = primitives[1];
  EXPECT_EQ(page.indices.size(), 9U);
  EXPECT_EQ(page.indices.size() + rest.indices.size(), 3 * scene.hierarchy().patches[leaf_].triangles);

  // The fan's middle has a place in each triangle, and so has each point that two of them share.
  EXPECT_EQ(page.positions.size(), 9U);
  EXPECT_EQ(page.places[1], glm::vec2(16.0F / 128.0F, 0.0F));
  EXPECT_EQ(page.places[5], glm::vec2(32.0F / 128.0F, 1.0F));
  EXPECT_TRUE(page.colors.empty());
  EXPECT_TRUE(base::decodeJpeg(page.picture));
  EXPECT_FALSE(page.masked);

  EXPECT_EQ(rest.colors.size(), rest.positions.size());
  EXPECT_TRUE(rest.picture.empty());
  const std::set<std::uint32_t> used(rest.indices.begin(), rest.indices.end());
  EXPECT_EQ(used.size(), rest.positions.size()) << "vertices of the page alone are left out";
}

TEST_F(TexturedSurface, keepsAlphaInAPngThatIsMasked) {
  const auto primitives = primitivesOf(texturedScene(4));
  ASSERT_EQ(primitives.size(), 2U);
  EXPECT_TRUE(primitives[0].masked);
  EXPECT_TRUE(primitives[0].picture_is_png);
  const auto image = base::decodePng(primitives[0].picture);
  ASSERT_TRUE(image) << image.error().message;
  EXPECT_EQ(image->at(3, 3)[3], 80);
  EXPECT_NEAR(image->at(3, 3)[0], 200, 3);
}

}  // namespace
