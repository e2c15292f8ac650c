// A textured flat that was scanned from inside is sampled and toured in its rooms, and its images show there what
// vertices cannot: the whole way of the programs.
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/egl/headless.h"
#include "base/json/camera_file.h"
#include "base/json/scene_file.h"
#include "base/picture_error.h"
#include "client/app/permalink.h"
#include "server/render/scene_renderer.h"
#include "server/scene/open_scene.h"
#include "server/trial/direct_viewer.h"
#include "tests/programs/run_program.h"

namespace {

using nlohmann::json;
using programs::run;

class Interior : public programs::ProgramTest {
 protected:
  void SetUp() override {
    programs::ProgramTest::SetUp();
    const auto made = run(
        "lumigrid", {"sample", "--shape", "rooms", "--triangles", "6000", "--texels", "500", "-o", path("flat.obj")});
    ASSERT_EQ(made.status, 0) << made.err;
  }
  std::vector<std::string> build() const {
    return {"build", path("flat.obj"), "-o", path("scene"), "--grid", "7", "--tiles", "1", "--quiet"};
  }
  std::vector<base::ViewCamera> tour(const std::vector<std::string>& options) const {
    std::vector<std::string> words{"tour", path("scene"), "-o", path("tour.json"), "--size", "320", "180"};
    words.insert(words.end(), options.begin(), options.end());
    const auto toured = run("lumigrid", words);
    EXPECT_EQ(toured.status, 0) << toured.err;
    auto read = base::readCameraPath(path("tour.json"));
    EXPECT_TRUE(read);
    return read ? std::move(read->frames) : std::vector<base::ViewCamera>();
  }
  /// The view that its viewers begin with, cut open from above.
  static base::ViewCamera firstView(const base::Scene& scene) {
    EXPECT_TRUE(scene.start_direction);
    const auto link = client::parsePermalink(scene.start_view);
    EXPECT_TRUE(link) << scene.start_view;
    base::ViewCamera view;
    view.direction = scene.start_direction.value_or(glm::dvec3(0.0, 0.0, -1.0));
    view.position = 0.5 * (scene.box_min + scene.box_max) - glm::length(scene.box_max - scene.box_min) * view.direction;
    view.up = scene.up;
    view.width = 320, view.height = 180;
    if (link) view.section = link->section.plane();
    return view;
  }
  static std::size_t within(const base::Scene& scene, const std::vector<base::ViewCamera>& views) {
    return static_cast<std::size_t>(std::count_if(views.begin(), views.end(), [&](const base::ViewCamera& view) {
      return glm::all(glm::greaterThan(view.position, scene.box_min)) &&
             glm::all(glm::lessThan(view.position, scene.box_max));
    }));
  }
};

TEST_F(Interior, isSampledInItsRoomsAndImagesShowItsWalls) {
  ASSERT_EQ(run("lumigrid", build()).status, 0);
  const auto scene = base::readScene(path("scene"));
  ASSERT_TRUE(scene);
  EXPECT_TRUE(scene->interior);
  const json images = json::parse(run("lumigrid", {"info", path("scene"), "--json"}).out)["images"];
  EXPECT_GT(images["points"].get<int>(), 10);
  EXPECT_LT(images["points"].get<int>(), images["grid_points"].get<int>());
  EXPECT_NEAR(images["spacing"].get<double>(), 9.36 / 6.0, 0.05) << "the box without a margin";

  // The same command finds all there, the scene tells its own options, and others are refused.
  EXPECT_EQ(run("lumigrid", build()).status, 0);
  EXPECT_EQ(run("lumigrid", {"build", "--missing", "-o", path("scene")}).status, 0);
  EXPECT_EQ(run("lumigrid", {"verify", path("scene")}).status, 0);
  std::vector<std::string> wider = build();
  wider.insert(wider.end(), {"--margin", "0.5"});
  programs::expectOneLineError(run("lumigrid", wider), 1, {"other meshes or options"});

  EXPECT_EQ(within(*scene, tour({"--frames", "9"})), 9U);
  EXPECT_EQ(within(*scene, tour({"--frames", "9", "--around"})), 0U);
  EXPECT_EQ(within(*scene, tour({"--frames", "9", "--distance", "1.5"})), 0U);
  EXPECT_EQ(within(*scene, tour({"--path", "walk", "--seconds", "1"})), 60U);

  // In its rooms images bring what patches lack, and no view is worse for them.
  std::vector<base::ViewCamera> views = tour({"--random", "6"});
  ASSERT_EQ(within(*scene, views), 6U);
  views.push_back(firstView(*scene));
  ASSERT_TRUE(views.back().section);
  const auto open = server::openScene(path("scene"));
  ASSERT_TRUE(open) << open.error().message;
  std::vector<base::Image> truths;
  {
    const auto context = base::HeadlessContext::create().value();
    const auto renderer = server::SceneRenderer::create((*open)->scene, (*open)->patches).value();
    const base::Sphere bounds{renderer->sceneCenter(), renderer->sceneRadius()};
    for (const base::ViewCamera& view : views)
      truths.push_back(
          renderer
              ->render(base::cameraForScene(view, scene->origin, bounds), {.tolerance_px = 0.0F, .supersampling = 4})
              .value()
              .rgba);
  }
  const auto shown = [&](bool with_images) {
    const auto context = base::HeadlessContext::create().value();
    client::ViewerOptions options = server::settledOptions(client::Method::kLumigraph);
    options.lumigraph.use_images = with_images;
    server::DirectViewer viewer((*open)->data, options);
    std::vector<double> psnr_db;
    for (std::size_t i = 0; i < views.size(); ++i)
      psnr_db.push_back(base::foregroundError(truths[i], viewer.show(views[i]).value()).psnr());
    return psnr_db;
  };
  const std::vector<double> alone = shown(false), blended = shown(true);
  double gained = 0.0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    std::printf("view %zu: %.1f dB by patches, %.1f with images\n", i, alone[i], blended[i]);
    EXPECT_GT(blended[i], alone[i] - 0.1) << i;
    gained += (blended[i] - alone[i]) / static_cast<double>(views.size());
  }
  EXPECT_GT(gained, 13.0) << "of 14.6; where boxes chose images, whatever hides them, it was 12";
  EXPECT_GT(blended.back(), alone.back() + 3.0) << "the first view, through the section, too";
}

// Images around it are made where they are asked for.
TEST_F(Interior, isSampledAroundWhereAMarginIsGiven) {
  std::vector<std::string> words = build();
  words.insert(words.end(), {"--margin", "0.5", "--methods", "patch"});
  ASSERT_EQ(run("lumigrid", words).status, 0);
  EXPECT_EQ(base::readScene(path("scene"))->parameters.at("margin"), "0.5");
  EXPECT_EQ(run("lumigrid", words).status, 0);
}

}  // namespace
