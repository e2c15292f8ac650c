// A scene with textures is drawn with them: letters far finer than a triangle can be read, and no chart of the texture
// shows beside another at any distance.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <optional>

#include "base/egl/headless.h"
#include "base/picture_error.h"
#include "base/png/png.h"
#include "lod/patch/builder/hierarchy_build.h"
#include "mesh/generate/font.h"
#include "mesh/generate/textured.h"
#include "server/render/scene_renderer.h"
#include "tests/support/temporary_directory.h"

namespace server {
namespace {

class TexturedSceneTest : public testing::Test {
 protected:
  void SetUp() override {
    auto context = base::HeadlessContext::create();
    ASSERT_TRUE(context) << context.error().message;
    context_ = std::move(*context);
  }
  void TearDown() override {
    renderer_.reset();
    EXPECT_EQ(base::gl::takeError(), "");
  }

  // Builds the mesh file and opens it, with or without its textures.
  void build(const std::string& mesh) {
    lod::patch::builder::HierarchyOptions options;
    options.texture_path = folder_ / "texture.lgt";
    const auto built = lod::patch::builder::buildHierarchyFromFiles({folder_ / mesh}, options, folder_ / "patch.lgp");
    ASSERT_TRUE(built) << built.error().message;
    scene_.origin = built->origin, scene_.box_min = built->box_min, scene_.box_max = built->box_max;
    scene_.has_colors = true;
    scene_.light.mode = base::LightMode::kUnlit;
  }
  void open(bool textured) {
    scene_.parts = {{"patch.lgp", 0, ""}};
    if (textured) scene_.parts.push_back({"texture.lgt", 0, ""});
    renderer_.reset();
    patches_.reset();
    auto patches = lod::patch::PatchFile::open(folder_ / "patch.lgp");
    ASSERT_TRUE(patches) << patches.error().message;
    patches_.emplace(std::move(*patches));
    auto renderer = SceneRenderer::create(scene_, *patches_);
    ASSERT_TRUE(renderer) << renderer.error().message;
    renderer_ = std::move(*renderer);
  }

  base::Image draw(const base::ViewCamera& view, const RenderOptions& options) {
    auto drawn = renderer_->render(base::cameraFromView(view, scene_.origin, 0.01F, 10000.0F), options);
    if (!drawn) {
      ADD_FAILURE() << drawn.error().message;
      return {};
    }
    return std::move(drawn->rgba);
  }

  // Builds a facade with signs.
  mesh::generate::TexturedOptions buildFacade() {
    mesh::generate::TexturedOptions options;
    options.triangles = 3'000;
    options.texels = 900;
    EXPECT_TRUE(mesh::generate::writeTexturedObj(options, folder_ / "facade.obj"));
    build("facade.obj");
    return options;
  }

  const support::TemporaryDirectory folder_;
  std::unique_ptr<base::HeadlessContext> context_;
  base::Scene scene_;
  std::optional<lod::patch::PatchFile> patches_;
  std::unique_ptr<SceneRenderer> renderer_;
};

double correlation(const std::vector<double>& a, const std::vector<double>& b) {
  const auto n = static_cast<double>(a.size());
  double sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    sa += a[i], sb += b[i], saa += a[i] * a[i], sbb += b[i] * b[i], sab += a[i] * b[i];
  return (n * sab - sa * sb) / std::sqrt(std::max(1e-30, (n * saa - sa * sa) * (n * sbb - sb * sb)));
}

// How like the sign's own letters, 12 pixels high, the picture of it is.
double lettersIn(const base::Image& picture, const mesh::generate::Sign& sign, double pixel) {
  std::vector<double> seen, written;
  const double cell = sign.height / mesh::generate::kGlyphRows;
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x) {
      const glm::dvec2 low = glm::dvec2(x, picture.height - 1 - y) * pixel / cell;
      const std::uint8_t* p = picture.at(x, y);
      seen.push_back(255.0 - (p[0] + p[1] + p[2]) / 3.0);
      written.push_back(mesh::generate::inkIn(sign.text, low, low + pixel / cell));
    }
  return correlation(seen, written);
}

TEST_F(TexturedSceneTest, letteringOfTwelvePixelsIsRead) {
  const mesh::generate::TexturedOptions options = buildFacade();
  const auto signs = mesh::generate::signsOf(options.shape, options.seed);
  int judged = 0;
  for (const mesh::generate::Sign& sign : signs) {
    if (sign.height < 0.15) continue;  // the texture itself has fewer than 12 texels for these
    constexpr double kPixels = 12.0;
    const double pixel = sign.height / kPixels;
    const double width = mesh::generate::textWidth(sign.text) * sign.height / mesh::generate::kGlyphRows;
    base::ViewCamera view;
    view.direction = -glm::cross(sign.right, sign.up);
    view.up = sign.up;
    view.width = static_cast<int>(std::lround(width / pixel)), view.height = static_cast<int>(kPixels);
    view.ortho_height = sign.height;
    view.position = sign.corner + 0.5 * width * sign.right + 0.5 * sign.height * sign.up - 5.0 * view.direction;
    open(true);
    const double textured = lettersIn(draw(view, {.tolerance_px = 0.0F, .supersampling = 2}), sign, pixel);
    open(false);
    const double colored = lettersIn(draw(view, {.tolerance_px = 0.0F, .supersampling = 2}), sign, pixel);
    EXPECT_GT(textured, 0.9) << sign.text;
    EXPECT_LT(colored, textured - 0.2) << sign.text;
    ++judged;
  }
  EXPECT_GE(judged, 3);
}

// Seen at a slant a pixel is long on the texture: look-ups along it are needed, without which this has 35.2 dB.
TEST_F(TexturedSceneTest, slantedSurfacesAreNearTheTruth) {
  buildFacade();
  open(true);
  const glm::dvec3 middle = 0.5 * (scene_.box_min + scene_.box_max);
  base::ViewCamera view;
  view.direction = glm::normalize(glm::dvec3(-0.94, 0.0, -0.34));
  view.position = middle - 14.0 * view.direction;
  view.up = {0.0, 1.0, 0.0};
  view.width = 240, view.height = 320, view.fov_y = 0.7;
  const base::Image picture = draw(view, {.tolerance_px = 0.0F, .supersampling = 2});
  const base::Image truth = draw(view, {.tolerance_px = 0.0F, .supersampling = 8});
  EXPECT_GT(base::foregroundError(truth, picture).psnr(), 39.5);
}

// Faces are drawn in tiles. Look-ups at a tile's edge see the same pixels beside them as in the middle of a picture.
TEST_F(TexturedSceneTest, tilesShowWhatThePictureInOneShows) {
  buildFacade();
  open(true);
  base::ViewCamera view;
  view.direction = glm::normalize(glm::dvec3(-0.5, 0.1, -0.8));
  view.position = 0.5 * (scene_.box_min + scene_.box_max) - 14.0 * view.direction;
  view.up = {0.0, 1.0, 0.0};
  view.width = 300, view.height = 260, view.fov_y = 0.7;
  const base::Image whole = draw(view, {.tolerance_px = 0.0F, .supersampling = 2});
  const base::Image tiled = draw(view, {.tolerance_px = 0.0F, .supersampling = 2, .tile_samples = 90 * 90});
  EXPECT_GT(base::foregroundError(whole, tiled).psnr(), 60.0);
}

// A sheet of cells, each with a chart of its own; charts are red and lie in black.
class RedCharts : public TexturedSceneTest {
 protected:
  static constexpr int kCells = 24, kChart = 24, kGap = 4;  // cells a side, texels

  void write() {
    constexpr int kSide = kCells * (kChart + kGap);
    base::Image image(kSide, kSide, 3);
    for (int y = 0; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x)
        if (x % (kChart + kGap) < kChart && y % (kChart + kGap) < kChart) image.at(x, y)[0] = 220;
    ASSERT_TRUE(base::writePng(image, folder_ / "charts.png"));
    std::ofstream(folder_ / "sheet.mtl") << "newmtl charts\nmap_Kd charts.png\n";
    std::ofstream obj(folder_ / "sheet.obj");
    obj << "mtllib sheet.mtl\nusemtl charts\n";
    for (int j = 0; j <= kCells; ++j)
      for (int i = 0; i <= kCells; ++i) obj << "v " << i << ' ' << j << " 0\n";
    int uv = 1;
    // The charts lie in the picture in another order than the cells in the sheet.
    for (int j = 0; j < kCells; ++j)
      for (int i = 0; i < kCells; ++i, uv += 4) {
        const int ci = (i * 7 + j) % kCells, cj = (j * 5 + 3) % kCells;
        for (const auto& [x, y] : {std::pair{0, 0}, {1, 0}, {1, 1}, {0, 1}})
          obj << "vt " << double(ci * (kChart + kGap) + x * kChart) / kSide << ' '
              << 1.0 - double(cj * (kChart + kGap) + y * kChart) / kSide << '\n';
        const auto corner = [&](int x, int y, int k) {
          return std::to_string((j + y) * (kCells + 1) + i + x + 1) + '/' + std::to_string(uv + k) + ' ';
        };
        obj << "f " << corner(0, 0, 0) << corner(1, 0, 1) << corner(1, 1, 2) << '\n';
        obj << "f " << corner(0, 0, 0) << corner(1, 1, 2) << corner(0, 1, 3) << '\n';
      }
  }
};

TEST_F(RedCharts, noLineShowsAtAnyMipLevel) {
  write();
  build("sheet.obj");
  open(true);
  for (const double slant : {0.0, 1.2}) {
    // From a quarter of a texel a pixel to a hundred.
    for (double distance = 2.0; distance < 1000.0; distance *= 1.37) {
      base::ViewCamera view;
      view.direction = {0.0, std::sin(slant), -std::cos(slant)};
      view.position = glm::dvec3(0.5 * kCells, 0.5 * kCells, 0.0) - distance * view.direction;
      view.up = {0.0, 1.0, 0.1};
      view.width = 240, view.height = 160, view.fov_y = 0.8;
      const base::Image picture = draw(view, {.tolerance_px = 0.5F, .supersampling = 1});
      int wrong = 0, seen = 0;
      for (std::size_t i = 0; i < picture.pixels.size(); i += 4) {
        if (picture.pixels[i + 3] < 255) continue;
        ++seen;
        if (picture.pixels[i] < 205 || picture.pixels[i + 1] > 15 || picture.pixels[i + 2] > 15) ++wrong;
      }
      EXPECT_EQ(wrong, 0) << "of " << seen << " pixels at a distance of " << distance << ", slant " << slant;
    }
  }
}

// The right half of each chart is not there.
TEST_F(RedCharts, alphaLeavesOutWhatIsNotThere) {
  write();
  base::Image image = *base::readPng(folder_ / "charts.png");
  base::Image masked(image.width, image.height, 4);
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) {
      for (int k = 0; k < 3; ++k) masked.at(x, y)[k] = image.at(x, y)[k];
      masked.at(x, y)[3] = x % (kChart + kGap) < kChart / 2 ? 255 : 0;
    }
  ASSERT_TRUE(base::writePng(masked, folder_ / "charts.png"));
  build("sheet.obj");
  open(true);
  base::ViewCamera view;
  view.position = {12.0, 12.0, 10.0}, view.direction = {0.0, 0.0, -1.0}, view.up = {0.0, 1.0, 0.0};
  view.width = 320, view.height = 240;
  const base::Image picture = draw(view, {.tolerance_px = 0.0F});
  int covered = 0;
  for (std::size_t i = 0; i < picture.pixels.size(); i += 4) {
    if (picture.pixels[i + 3] == 0) continue;
    ++covered;
    EXPECT_GT(picture.pixels[i], 200);
  }
  EXPECT_NEAR(static_cast<double>(covered) / (320.0 * 240.0), 0.5, 0.03);
}

TEST_F(RedCharts, pictureDoesNotDependOnWhatWasDrawnBefore) {
  write();
  build("sheet.obj");
  base::ViewCamera near_view, far_view;
  near_view.position = {5.0, 5.0, 6.0}, far_view.position = {12.0, 12.0, 120.0};
  for (base::ViewCamera* view : {&near_view, &far_view}) {
    view->direction = {0.0, 0.3, -1.0}, view->up = {0.0, 1.0, 0.0};
    view->width = 160, view->height = 120;
  }
  open(true);
  const base::Image far_first = draw(far_view, {.tolerance_px = 0.0F});
  open(true);
  const base::Image near_first = draw(near_view, {.tolerance_px = 0.0F});
  EXPECT_EQ(draw(far_view, {.tolerance_px = 0.0F}).pixels, far_first.pixels);
  EXPECT_EQ(draw(near_view, {.tolerance_px = 0.0F}).pixels, near_first.pixels);
}

TEST_F(RedCharts, aMissingTextureFileIsNamed) {
  write();
  build("sheet.obj");
  std::filesystem::remove(folder_ / "texture.lgt");
  scene_.parts = {{"patch.lgp", 0, ""}, {"texture.lgt", 0, ""}};
  auto patches = lod::patch::PatchFile::open(folder_ / "patch.lgp");
  ASSERT_TRUE(patches);
  const auto renderer = SceneRenderer::create(scene_, *patches);
  ASSERT_FALSE(renderer);
  EXPECT_NE(renderer.error().message.find("texture.lgt"), std::string::npos) << renderer.error().message;
}

}  // namespace
}  // namespace server
