// Images never make the picture of their proxy worse: random views of scenes on which they did once, with and without
// images on the same cut, against the truth.
#include <gtest/gtest.h>

#include "base/egl/headless.h"
#include "compare/accuracy.h"
#include "lod/patch/proxy_sight.h"
#include "protocol/welcome.h"
#include "server/bake/face_encoder.h"
#include "server/render/scene_renderer.h"
#include "server/trial/direct_viewer.h"
#include "server/trial/own_context.h"
#include "server/views/enclosed.h"
#include "server/views/random_views.h"
#include "tests/support/failure_meshes.h"
#include "tests/support/made_scene.h"
#include "tests/support/temporary_directory.h"
#include "tests/support/test_meshes.h"

namespace {

struct Model {
  std::string name;
  support::Mesh (*mesh)();
};

/// Loses no more than nobody sees; a view may gain nothing.
constexpr double kMostPsnrLost = 0.1, kMostSsimLost = 0.001;

class ImagesHelp : public testing::TestWithParam<Model> {
 protected:
  void SetUp() override {
    support::Mesh mesh = GetParam().mesh();
    support::colorByPlace(mesh);
    const support::SceneContents contents{.points = 6};
    scene_ = support::makeScene(mesh, directory_.path(), contents).value();
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
  }
  base::Image truthOf(const base::ViewCamera& view) {
    const auto own = base::HeadlessContext::create().value();
    const auto renderer = server::SceneRenderer::create(scene_, patches_).value();
    const base::Sphere bounds{renderer->sceneCenter(), renderer->sceneRadius()};
    const base::Camera camera = base::cameraForScene(view, scene_.origin, bounds);
    return renderer->render(camera, {.tolerance_px = 0.0F, .supersampling = 4}).value().rgba;
  }
  /// Settled pictures on the same cut; coarse, so that images have something to add.
  std::vector<base::Image> pictures(const std::vector<base::ViewCamera>& views, bool with_images) {
    const auto context = base::HeadlessContext::create().value();
    client::ViewerOptions options = server::settledOptions(client::Method::kLumigraph);
    options.lumigraph.use_images = with_images;
    options.session.patch_tolerance_px = 2.0F;
    server::DirectViewer viewer(data_, options);
    std::vector<base::Image> shown;
    for (const base::ViewCamera& view : views) shown.push_back(viewer.show(view).value());
    return shown;
  }

  const support::TemporaryDirectory directory_;
  base::Scene scene_;
  lod::patch::PatchFile patches_;
  std::unique_ptr<repository::Store> store_;
  lod::patch::ProxySight sight_;
  server::SceneData data_;
};

TEST_P(ImagesHelp, noViewIsWorseForThem) {
  server::RandomViews wanted;
  wanted.count = 8;
  wanted.width = 320, wanted.height = 180;
  const auto views = server::randomViews(scene_, server::Enclosure::create(patches_).value(), wanted);
  const auto alone = pictures(views, false);
  const auto blended = pictures(views, true);
  int seen = 0;
  double gained = 0.0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const base::Image truth = truthOf(views[i]);
    if (!server::showsModel(truth)) continue;
    const auto proxy = compare::measureAccuracy(truth, alone[i]).value();
    const auto images = compare::measureAccuracy(truth, blended[i]).value();
    EXPECT_GE(images.psnr_db, proxy.psnr_db - kMostPsnrLost) << "view " << i;
    EXPECT_GE(images.ssim, proxy.ssim - kMostSsimLost) << "view " << i;
    gained += images.psnr_db - proxy.psnr_db;
    ++seen;
  }
  ASSERT_GT(seen, 3);
  std::printf("images gain %.2f dB in %d views\n", gained / seen, seen);
}

support::Mesh boxOfFlatColors() {
  return support::box(glm::vec3(-0.5F), glm::vec3(0.5F), 60);
}
support::Mesh bumpyBall() {
  return support::bumpySphere(160, 320, 0.05F);
}

INSTANTIATE_TEST_SUITE_P(On, ImagesHelp,
                         testing::Values(Model{"a_box", boxOfFlatColors}, Model{"a_room", support::room},
                                         Model{"a_bumpy_ball", bumpyBall}, Model{"a_cup", support::cup}),
                         [](const auto& model) { return model.param.name; });

}  // namespace
