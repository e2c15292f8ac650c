// lumigrid-view streams points and umbrellas from nginx and from a server of ours, as a user has them.
#include "tests/programs/pmr_scene.h"
#include "tests/programs/published_site.h"

namespace {

namespace fs = std::filesystem;
using programs::expectOneLineError;
using programs::readText;
using programs::run;
using programs::Tour;
using programs::writeText;

/// path("site/tower") is the published form of scene_, which has points and umbrellas only.
class StreamedUmbrellasTest : public programs::PublishedSite {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    LUMIGRID_SKIP_WITHOUT_NGINX();
    scene_ = path("scene");
    programs::writePmrScene(scene_);
    ASSERT_EQ(run("lumigrid", {"publish", scene_, path("site/tower"), "--quiet"}).status, 0);
    makeTour(4, 320, 180);
  }
  /// Asks for no method where `method` is empty. Pictures of one sample a pixel are as `lumigrid render` draws them.
  void expectLocalPicturesFrom(const std::string& url, const std::string& name, const std::string& method = "") {
    const Tour seen = tour(url, name, method, {"--no-antialias"});
    expectLocalPictures(seen, "pmr");
    EXPECT_GT(seen.lines.back()["umbrellas"]["triangles"].get<int>(), 1000);
    EXPECT_EQ(seen.lines.back()["umbrellas"]["lacking"], 0);
    EXPECT_EQ(seen.lines.back()["umbrellas"]["failures"], 0);
  }
  programs::Outcome view(const std::string& url, const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments{url, "--headless", "--path", path("tour.json"), "--connect-timeout", "3"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run("lumigrid-view", arguments);
  }
};

TEST_F(StreamedUmbrellasTest, picturesEqualLocalOnesPixelForPixelWhereverTheSceneLies) {
  const support::Nginx nginx(path("site"));
  expectLocalPicturesFrom(nginx.url() + "/tower/", "published", "pmr");
  expectLocalPicturesFrom(serve(scene_).url, "served", "pmr");
  expectLocalPicturesFrom(scene_, "folder", "pmr");
  expectLocalPicturesFrom(path("site/tower"), "published_folder", "pmr");
}

TEST_F(StreamedUmbrellasTest, areShownWithoutBeingAskedForWhereThereIsNothingElse) {
  const support::Nginx nginx(path("site"));
  expectLocalPicturesFrom(nginx.url() + "/tower/", "published");
  expectLocalPicturesFrom(serve(scene_).url, "served");
  expectLocalPicturesFrom(serve(nginx.url() + "/tower", {"--cache", path("cache")}).url, "far");
  expectLocalPicturesFrom(scene_, "folder");
}

TEST_F(StreamedUmbrellasTest, refusesOtherMethodsWithTheReason) {
  const support::Nginx nginx(path("site"));
  for (const std::string& url : {serve(scene_).url, nginx.url() + "/tower/", scene_})
    expectOneLineError(view(url, {"--method", "patches"}), 1, {"--method pmr"});
  for (const std::string& url : {serve(scene_).url, nginx.url() + "/tower/", scene_})
    expectOneLineError(view(url, {"--method", "qsplat"}), 1, {"has no splats", "--methods qsplat"});
  EXPECT_EQ(view(scene_, {"--method", "pmr", "--tolerance", "0.1"}).status, 2);
}

TEST_F(StreamedUmbrellasTest, samplesAndToleranceAreOptions) {
  const Tour fine = tour(scene_, "fine", "pmr");
  const Tour coarse = tour(scene_, "coarse", "pmr", {"--tolerance", "20"});
  EXPECT_EQ(fine.lines.front()["samples_per_pixel"], 4);
  EXPECT_LT(4 * coarse.lines.front()["umbrellas"]["triangles"].get<int>(),
            fine.lines.front()["umbrellas"]["triangles"].get<int>());
  EXPECT_NE(coarse.pictures.front().pixels, fine.pictures.front().pixels);
}

TEST_F(StreamedUmbrellasTest, aFileThatIsCutOrAnotherOneIsNamed) {
  const support::Nginx nginx(path("site"));
  std::string file;
  for (const auto& entry : fs::directory_iterator(path("site/tower")))
    if (entry.path().extension() == ".lgm") file = entry.path().string();
  const std::string bytes = readText(file);
  writeText(file, bytes.substr(0, bytes.size() / 2));
  for (const std::string& url : {nginx.url() + "/tower/", path("site/tower")})
    expectOneLineError(view(url, {"--method", "pmr"}), 1, {".lgm"});
  writeText(file, "no points" + bytes.substr(9));
  for (const std::string& url : {nginx.url() + "/tower/", path("site/tower")})
    expectOneLineError(view(url, {"--method", "pmr"}), 1, {".lgm"});
  fs::remove(file);
  expectOneLineError(view(nginx.url() + "/tower/", {"--method", "pmr"}), 1, {".lgm", "is not there"});
}

}  // namespace
