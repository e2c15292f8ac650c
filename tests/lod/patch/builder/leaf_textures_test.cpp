// The leaves' pages show at each place of the surface what the source's pictures show there.
#include "lod/patch/builder/leaf_textures.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <functional>

#include "base/jpeg/jpeg.h"
#include "base/png/png.h"
#include "lod/patch/builder/hierarchy_build.h"
#include "lod/patch/format.h"
#include "lod/patch/traverse.h"
#include "tests/support/temporary_directory.h"

namespace lod::patch::builder {
namespace {

constexpr int kSide = 256;      // of a picture, pixels
constexpr int kCells = 60;      // of the sheet, along each side: 7200 triangles, so that there are several leaves
constexpr double kMost = 20.0;  // levels that JPEG errs by beside the edge of a chart, and the place by
constexpr double kMean = 1.5;   // on the mean

// Where a picture shows a place of its half of the sheet, 0..1 and 0..1, in pictures: x to the right, y downwards.
using UvOf = std::function<glm::dvec2(const glm::dvec2& place)>;

// A sheet in the plane z = 0. Its left half shows one picture as it lies, its right half another, turned and mirrored;
// the row of cells at y = 0 shows none.
class TexturedSheet : public testing::Test {
 protected:
  void SetUp() override {
    for (int p = 0; p < 2; ++p) {
      // Red and green tell the place, blue the picture.
      base::Image image(kSide, kSide, 3);
      for (int y = 0; y < kSide; ++y)
        for (int x = 0; x < kSide; ++x) {
          image.at(x, y)[0] = static_cast<std::uint8_t>(x);
          image.at(x, y)[1] = static_cast<std::uint8_t>(y);
          image.at(x, y)[2] = p == 0 ? 60 : 200;
        }
      if (p == 0) {
        ASSERT_TRUE(base::writePng(image, folder_ / "picture0.png"));
      } else {  // pages copy its blocks
        const auto jpeg = base::encodeJpeg(image, 95, base::Subsampling::k420);
        ASSERT_TRUE(jpeg);
        writeFile("picture1.jpg", *jpeg);
      }
    }
    std::ofstream(folder_ / "sheet.mtl") << "newmtl left\nmap_Kd picture0.png\nnewmtl right\nmap_Kd picture1.jpg\n";
    writeObj();
  }

  void writeFile(const char* name, base::ByteView bytes) const {
    std::ofstream(folder_ / name, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  }

  static int pictureAt(const glm::dvec2& p) { return p.x < 0.5 * kCells ? 0 : 1; }
  static glm::dvec2 uvAt(const glm::dvec2& p, int picture) {
    const glm::dvec2 at(picture == 0 ? p.x / (0.5 * kCells) : p.x / (0.5 * kCells) - 1.0, p.y / kCells);
    return picture == 0 ? at : glm::dvec2(at.y, at.x);
  }

  void writeObj() {
    std::ofstream obj(folder_ / "sheet.obj");
    obj << "mtllib sheet.mtl\n";
    for (int j = 0; j <= kCells; ++j)
      for (int i = 0; i <= kCells; ++i) obj << "v " << i << ' ' << j << " 0\n";
    int uv = 0;
    for (const char* material : {"none", "left", "right"}) {
      obj << "usemtl " << material << '\n';
      for (int j = 0; j < kCells; ++j)
        for (int i = 0; i < kCells; ++i) {
          const int picture = pictureAt({i, j});
          if ((j == 0 ? "none" : picture == 0 ? "left" : "right") != std::string(material)) continue;
          for (const auto& [x, y] : {std::pair{0, 0}, {1, 0}, {1, 1}, {0, 1}}) {
            const glm::dvec2 at = uvAt({i + x, j + y}, picture);
            obj << "vt " << at.x << ' ' << 1.0 - at.y << '\n';
          }
          const auto corner = [&](int x, int y, int k) {
            return std::to_string((j + y) * (kCells + 1) + i + x + 1) + '/' + std::to_string(uv + k + 1) + ' ';
          };
          obj << "f " << corner(0, 0, 0) << corner(1, 0, 1) << corner(1, 1, 2) << '\n';
          obj << "f " << corner(0, 0, 0) << corner(1, 1, 2) << corner(0, 1, 3) << '\n';
          uv += 4;
        }
    }
  }

  HierarchySummary build(unsigned threads = 2) {
    HierarchyOptions options;
    options.limits.threads = threads;
    options.texture_path = folder_ / "texture.lgt";
    auto built = buildHierarchyFromFiles({folder_ / "sheet.obj"}, options, folder_ / "patch.lgp");
    EXPECT_TRUE(built) << built.error().message;
    return built ? std::move(*built) : HierarchySummary{};
  }

  std::string bytesOf(const char* name) const {
    std::ifstream file(folder_ / name, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }

  const support::TemporaryDirectory folder_;
};

// Calls check(place on the sheet, texel) at the middle and near the corners of each triangle of a page.
void forEachSample(const PatchGeometry& geometry, const Lattice& lattice, const texture::Page& page,
                   const std::function<void(const glm::dvec2&, const std::uint8_t*)>& check) {
  for (const texture::PageTriangle& t : page.triangles)
    for (const glm::dvec3& weight :
         {glm::dvec3(1.0 / 3.0), glm::dvec3(0.8, 0.1, 0.1), glm::dvec3(0.1, 0.8, 0.1), glm::dvec3(0.1, 0.1, 0.8)}) {
      glm::dvec3 place(0.0);
      glm::dvec2 texel(0.0);
      for (int k = 0; k < 3; ++k) {
        const std::size_t v = geometry.indices[3 * std::size_t{t.triangle} + static_cast<std::size_t>(k)];
        place += weight[k] * glm::dvec3(lattice.position(geometry.positions[v]));
        texel += weight[k] * glm::dvec2(t.corners[static_cast<std::size_t>(k)]) / double{texture::kCornerSteps};
      }
      check(glm::dvec2(place), page.image.at(static_cast<int>(texel.x), static_cast<int>(texel.y)));
    }
}

TEST_F(TexturedSheet, everyPageShowsWhatThePictureShowsThere) {
  const auto summary = build();
  ASSERT_TRUE(summary.texture);
  EXPECT_TRUE(summary.warnings.empty());
  EXPECT_EQ(summary.texture->pictures, 2U);
  EXPECT_EQ(summary.texture->triangles, 2U * kCells * (kCells - 1));
  // All of both pictures but their share of the row without a texture.
  EXPECT_NEAR(static_cast<double>(summary.texture->texels), 2.0 * kSide * kSide * (kCells - 1) / kCells, 100.0);

  const auto patches = PatchFile::open(folder_ / "patch.lgp");
  const auto textures = texture::TextureFile::open(folder_ / "texture.lgt");
  ASSERT_TRUE(patches && textures);
  EXPECT_TRUE(textures->verify().empty());
  std::uint64_t triangles = 0;
  double error = 0.0, samples = 0.0;
  for (std::uint32_t p = 0; p < patches->hierarchy().patches.size(); ++p) {
    for (const texture::PageRecord& record : textures->pagesOf(p)) {
      EXPECT_EQ(patches->hierarchy().patches[p].level, 0);
      const auto geometry = patches->geometry(p);
      const auto page = textures->page(record);
      ASSERT_TRUE(geometry && page);
      triangles += page->triangles.size();
      // A texel is a 256th of half of the sheet wide and of the whole sheet high, or the other way round.
      EXPECT_NEAR(static_cast<double>(record.texel), std::sqrt(0.5 * kCells * kCells) / kSide, 1e-3);
      forEachSample(*geometry, patches->hierarchy().lattice, *page, [&](const glm::dvec2& at, const std::uint8_t* got) {
        const int picture = pictureAt(at);
        const glm::dvec2 wanted = uvAt(at, picture) * static_cast<double>(kSide);
        const glm::dvec3 off =
            glm::abs(glm::dvec3(got[0], got[1], got[2]) - glm::dvec3(wanted - 0.5, picture == 0 ? 60.0 : 200.0));
        EXPECT_LT(std::max({off.x, off.y, off.z}), kMost) << at.x << ' ' << at.y;
        error += (off.x + off.y + off.z) / 3.0;
        samples += 1.0;
      });
    }
  }
  EXPECT_EQ(triangles, 2U * kCells * (kCells - 1));
  EXPECT_LT(error / samples, kMean);
}

TEST_F(TexturedSheet, doesNotDependOnThreads) {
  build(1);
  const std::string patches = bytesOf("patch.lgp"), textures = bytesOf("texture.lgt");
  EXPECT_FALSE(textures.empty());
  build(3);
  EXPECT_EQ(bytesOf("patch.lgp"), patches);
  EXPECT_EQ(bytesOf("texture.lgt"), textures);
}

TEST_F(TexturedSheet, goesOnBehindThePicturesThatWereDone) {
  build();
  const std::string patches = bytesOf("patch.lgp"), textures = bytesOf("texture.lgt");
  // The build is cancelled after each picture in turn, and then once more while groups are simplified.
  HierarchyOptions options;
  options.texture_path = folder_ / "texture.lgt";
  options.resume_key = [] { return base::Result<std::string>("sheet"); };
  for (const double stop : {0.1, 0.6, 2.0}) {
    std::filesystem::remove(folder_ / "texture.lgt");
    const auto cancel = [&](const std::string& stage, double done) {
      return !(stage == "textures" && done >= stop) && !(stage == "simplify" && stop > 1.0);
    };
    const auto stopped = buildHierarchyFromFiles({folder_ / "sheet.obj"}, options, folder_ / "patch.lgp", cancel);
    ASSERT_FALSE(stopped);
    EXPECT_EQ(stopped.error().code, base::ErrorCode::kCancelled);
  }
  const auto built = buildHierarchyFromFiles({folder_ / "sheet.obj"}, options, folder_ / "patch.lgp");
  ASSERT_TRUE(built) << built.error().message;
  EXPECT_EQ(bytesOf("patch.lgp"), patches);
  EXPECT_EQ(bytesOf("texture.lgt"), textures);
}

TEST_F(TexturedSheet, aJpegThatBreaksMeanwhileIsNamed) {
  HierarchyOptions options;
  options.texture_path = folder_ / "texture.lgt";
  const auto breakIt = [&](const std::string& stage, double done) {
    // Its vertices' colours have been made.
    if (stage == "leaves" && done >= 1.0) std::filesystem::resize_file(folder_ / "picture1.jpg", 1500);
    return true;
  };
  const auto built = buildHierarchyFromFiles({folder_ / "sheet.obj"}, options, folder_ / "patch.lgp", breakIt);
  ASSERT_FALSE(built);
  EXPECT_EQ(built.error().code, base::ErrorCode::kInvalidInput);
  EXPECT_NE(built.error().message.find("picture1.jpg"), std::string::npos) << built.error().message;
}

TEST_F(TexturedSheet, aPictureThatChangedMeanwhileIsReadAgain) {
  HierarchyOptions options;
  options.texture_path = folder_ / "texture.lgt";
  options.resume_key = [] { return base::Result<std::string>("sheet"); };
  const auto cancel = [](const std::string& stage, double) { return stage != "simplify"; };
  ASSERT_FALSE(buildHierarchyFromFiles({folder_ / "sheet.obj"}, options, folder_ / "patch.lgp", cancel));
  ASSERT_TRUE(base::writePng(base::Image(kSide, kSide, 3), folder_ / "picture0.png"));
  const auto resumed = buildHierarchyFromFiles({folder_ / "sheet.obj"}, options, folder_ / "patch.lgp");
  ASSERT_TRUE(resumed) << resumed.error().message;
  const std::string patches = bytesOf("patch.lgp"), textures = bytesOf("texture.lgt");
  build();
  EXPECT_EQ(bytesOf("patch.lgp"), patches);
  EXPECT_EQ(bytesOf("texture.lgt"), textures);
}

TEST_F(TexturedSheet, chartsThatAreTooLargeForAPageAreReducedAndCounted) {
  ASSERT_TRUE(base::writePng(base::Image(9000, 8, 3), folder_ / "picture0.png"));
  const auto summary = build();
  ASSERT_TRUE(summary.texture);
  EXPECT_GT(summary.texture->reduced_pages, 0U);
  const auto textures = texture::TextureFile::open(folder_ / "texture.lgt");
  ASSERT_TRUE(textures) << textures.error().message;
  EXPECT_EQ(textures->verify(), std::vector<std::string>{});
}

TEST_F(TexturedSheet, leavesSayWhatDetailTheirVerticesLack) {
  // Noise of 100 levels on either side of a mean, a texel each: the vertices' means know nothing of it.
  base::Image noise(kSide, kSide, 3);
  std::uint32_t random = 1;
  for (std::uint8_t& value : noise.pixels) {
    random = random * 1664525U + 1013904223U;
    value = random >> 31 != 0 ? 228 : 28;
  }
  ASSERT_TRUE(base::writePng(noise, folder_ / "picture0.png"));
  const auto summary = build();
  ASSERT_TRUE(summary.texture);
  const auto patches = PatchFile::open(folder_ / "patch.lgp");
  ASSERT_TRUE(patches) << patches.error().message;
  double most = 0.0, least = 1.0;
  for (const Patch& patch : patches->hierarchy().patches) {
    if (patch.level != 0) continue;
    const auto detail = static_cast<double>(colorDetailOf(patch));
    if (patch.box.max.x < 0.4F * kCells && patch.box.min.y > 1.0F) least = std::min(least, detail);
    if (patch.box.min.x > 0.5F * kCells) most = std::max(most, detail);
  }
  EXPECT_GT(least, 0.3);  // 100 levels are 0.39
  EXPECT_LT(most, 0.02);  // a gradient is what vertices show as well

  // So a cut by what is seen draws the leaves on the left wherever a triangle is larger than a pixel or so.
  CutRequest request;
  base::ViewCamera view;
  view.position = {0.25 * kCells, 0.5 * kCells, 20.0};
  view.direction = {0.0, 0.0, -1.0};
  view.up = {0.0, 1.0, 0.0};
  view.width = 640, view.height = 480;
  request.camera = base::cameraFromView(view, glm::dvec3(0.0), 0.1F, 1000.0F);
  request.tolerance_px = 1.0F;
  for (const std::uint32_t p : selectCut(patches->hierarchy(), request).patches)
    EXPECT_EQ(patches->hierarchy().patches[p].level, 0);
}

TEST_F(TexturedSheet, vertexColoursAloneWarn) {
  HierarchyOptions options;
  const auto built = buildHierarchyFromFiles({folder_ / "sheet.obj"}, options, folder_ / "patch.lgp");
  ASSERT_TRUE(built) << built.error().message;
  EXPECT_FALSE(built->texture);
  ASSERT_EQ(built->warnings.size(), 1U);
  EXPECT_NE(built->warnings[0].find("texels for every vertex"), std::string::npos) << built->warnings[0];
}

}  // namespace
}  // namespace lod::patch::builder
