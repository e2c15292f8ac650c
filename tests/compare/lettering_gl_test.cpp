// Lettering that only a texture carries can be read in the blended picture: images bring what patches cannot.
#include <gtest/gtest.h>

#include <cmath>

#include "base/egl/headless.h"
#include "lod/patch/builder/hierarchy_build.h"
#include "lod/patch/proxy_sight.h"
#include "mesh/generate/font.h"
#include "mesh/generate/textured.h"
#include "protocol/welcome.h"
#include "server/trial/direct_viewer.h"
#include "server/trial/own_context.h"
#include "tests/support/made_scene.h"
#include "tests/support/temporary_directory.h"

namespace {

using mesh::generate::Sign;

constexpr double kPixels = 12.0;  // of the letters' height

// A facade whose letters lie between its vertices, with images around it.
class Lettering : public testing::Test {
 protected:
  void SetUp() override {
    mesh::generate::TexturedOptions facade;
    facade.triangles = 3'000;
    facade.texels = 900;
    ASSERT_TRUE(mesh::generate::writeTexturedObj(facade, directory_ / "facade.obj"));
    lod::patch::builder::HierarchyOptions options;
    options.texture_path = directory_ / "texture.lgt";
    const auto built =
        lod::patch::builder::buildHierarchyFromFiles({directory_ / "facade.obj"}, options, directory_ / "patch.lgp");
    ASSERT_TRUE(built) << built.error().message;
    scene_.origin = built->origin, scene_.box_min = built->box_min, scene_.box_max = built->box_max;
    scene_.has_colors = true, scene_.triangles = built->triangles;
    scene_.light.mode = base::LightMode::kUnlit;
    scene_.parts = {{"patch.lgp", 1, ""}, {"texture.lgt", 1, ""}};
    const support::SceneContents contents{.points = 6, .face = 1024};
    ASSERT_TRUE(support::bakeScene(scene_, directory_.path(), contents));
    patches_ = lod::patch::PatchFile::open(directory_ / "patch.lgp").value();
    store_ = repository::openLmdbStore(directory_ / "images", repository::StoreMode::kRead).value();
    sight_ = lod::patch::ProxySight::ofFile(patches_).value();
    data_.welcome = protocol::welcomeOf(scene_, "test");
    server::describeHierarchy(patches_.hierarchy(), data_.welcome);
    data_.welcome.grid = support::gridOf(scene_, contents);
    data_.patches = &patches_;
    data_.images = store_.get();
    data_.sight = &sight_;
    data_.ahead_bytes = 0;
    signs_ = mesh::generate::signsOf(facade.shape, facade.seed);
  }

  // A view straight at the sign.
  static base::ViewCamera viewOf(const Sign& sign) {
    const double pixel = sign.height / kPixels;
    base::ViewCamera view;
    view.width = 480, view.height = 120;
    view.fov_y = 0.5;
    view.direction = -glm::cross(sign.right, sign.up);
    view.up = sign.up;
    const double distance = 0.5 * view.height * pixel / std::tan(0.5 * view.fov_y);
    view.position =
        sign.corner + 0.5 * widthOf(sign) * sign.right + 0.5 * sign.height * sign.up - distance * view.direction;
    return view;
  }
  static double widthOf(const Sign& sign) {
    return mesh::generate::textWidth(sign.text) * sign.height / mesh::generate::kGlyphRows;
  }
  // Settled, and of patches and images alone.
  base::Image shown(const base::ViewCamera& view, bool with_images) {
    const auto context = base::HeadlessContext::create().value();
    client::ViewerOptions options = server::settledOptions(client::Method::kLumigraph);
    options.lumigraph.use_images = with_images;
    server::DirectViewer viewer(data_, options);
    return viewer.show(view).value();
  }

  const support::TemporaryDirectory directory_;
  base::Scene scene_;
  lod::patch::PatchFile patches_;
  std::unique_ptr<repository::Store> store_;
  lod::patch::ProxySight sight_;
  server::SceneData data_;
  std::vector<Sign> signs_;
};

// The correlation of the picture's darkness with the letters' ink, over the sign in its middle.
double lettersIn(const base::Image& picture, const Sign& sign) {
  const double cell = kPixels / mesh::generate::kGlyphRows;
  const double width = mesh::generate::textWidth(sign.text) * cell;
  const glm::dvec2 corner(0.5 * picture.width - 0.5 * width, 0.5 * picture.height + 0.5 * kPixels);
  double n = 0, sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0;
  for (int y = static_cast<int>(corner.y - kPixels); y < static_cast<int>(corner.y); ++y)
    for (int x = std::max(0, static_cast<int>(corner.x)); x < std::min<int>(picture.width, corner.x + width); ++x) {
      const glm::dvec2 low = glm::dvec2(x - corner.x, corner.y - (y + 1)) / cell;
      const std::uint8_t* p = picture.at(x, y);
      const double a = 255.0 - (p[0] + p[1] + p[2]) / 3.0;
      const double b = mesh::generate::inkIn(sign.text, low, low + 1.0 / cell);
      n += 1, sa += a, sb += b, saa += a * a, sbb += b * b, sab += a * b;
    }
  return (n * sab - sa * sb) / std::sqrt(std::max(1e-30, (n * saa - sa * sa) * (n * sbb - sb * sb)));
}

TEST_F(Lettering, ofTwelvePixelsIsReadInTheBlendedPicture) {
  int judged = 0;
  for (const Sign& sign : signs_) {
    if (sign.height < 0.2) continue;  // images of 1024 pixels a side at this grid have fewer pixels for these
    const base::ViewCamera view = viewOf(sign);
    const double alone = lettersIn(shown(view, false), sign);
    const double blended = lettersIn(shown(view, true), sign);
    std::printf("%s: %.2f by patches, %.2f with images\n", sign.text.c_str(), alone, blended);
    EXPECT_GT(blended, 0.75) << sign.text;
    EXPECT_GT(blended, alone + 0.15) << sign.text;
    ++judged;
  }
  EXPECT_GE(judged, 3);
}

}  // namespace
