// lumigrid-view streams points and umbrellas, and triangles and points, from nginx and from a server of ours, as a user
// has them.
#include "tests/programs/pmr_scene.h"
#include "tests/programs/published_site.h"
#include "tests/support/made_hlod.h"

namespace {

namespace fs = std::filesystem;
using programs::expectOneLineError;
using programs::readText;
using programs::run;
using programs::Tour;
using programs::writeText;

/// A method whose file comes in pieces.
struct PieceMethod {
  base::StreamedMethod method;
  std::string figures;                ///< member of frames.jsonl
  std::vector<std::string> coarse;    ///< options of a picture that is coarser by far
  std::vector<std::string> too_fine;  ///< options that are refused
  void (*write)(const std::string& directory) = nullptr;
};
/// Tests are listed by the method's name.
void PrintTo(const PieceMethod& method, std::ostream* out) {
  *out << method.method.name;
}

class StreamedPiecesTest : public programs::PublishedSite, public ::testing::WithParamInterface<PieceMethod> {
 protected:
  /// path("site/tower") is the published form of scene_, which has the method's file only.
  void SetUp() override {
    ProgramTest::SetUp();
    LUMIGRID_SKIP_WITHOUT_NGINX();
    scene_ = path("scene");
    GetParam().write(scene_);
    ASSERT_EQ(run("lumigrid", {"publish", scene_, path("site/tower"), "--quiet"}).status, 0);
    makeTour(4, 320, 180);
  }
  static std::string name() { return GetParam().method.name; }
  static std::string extension() { return GetParam().method.extension; }
  /// Asks for no method where `method` is empty. Pictures of one sample a pixel are as `lumigrid render` draws them.
  void expectLocalPicturesFrom(const std::string& url, const std::string& folder, const std::string& method = "") {
    const Tour seen = tour(url, folder, method, {"--no-antialias"});
    expectLocalPictures(seen, name());
    const nlohmann::json& figures = seen.lines.back()[GetParam().figures];
    EXPECT_GT(figures["triangles"].get<int>(), 1000);
    EXPECT_EQ(figures["lacking"], 0);
    EXPECT_EQ(figures["failures"], 0);
  }
  programs::Outcome view(const std::string& url, const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments{url, "--headless", "--path", path("tour.json"), "--connect-timeout", "3"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run("lumigrid-view", arguments);
  }
};

std::string nameOfMethod(const ::testing::TestParamInfo<PieceMethod>& method) {
  return method.param.method.name;
}

PieceMethod umbrellas() {
  return {base::kUmbrellaMethod,
          "umbrellas",
          {"--tolerance", "20"},
          {"--tolerance", "0.1"},
          [](const std::string& directory) { programs::writePmrScene(directory); }};
}
PieceMethod hlod() {
  return {base::kHlodMethod, "hlod", {"--error-px", "20"}, {"--error-px", "0.1"}, [](const std::string& directory) {
            programs::writeStreamedScene(directory, base::kHlodMethod, support::madeHlod().file, 1.0);
          }};
}

INSTANTIATE_TEST_SUITE_P(Of, StreamedPiecesTest, ::testing::Values(umbrellas(), hlod()), nameOfMethod);

TEST_P(StreamedPiecesTest, picturesEqualLocalOnesPixelForPixelWhereverTheSceneLies) {
  const support::Nginx nginx(path("site"));
  expectLocalPicturesFrom(nginx.url() + "/tower/", "published", name());
  expectLocalPicturesFrom(serve(scene_).url, "served", name());
  expectLocalPicturesFrom(scene_, "folder", name());
  expectLocalPicturesFrom(path("site/tower"), "published_folder", name());
}

TEST_P(StreamedPiecesTest, areShownWithoutBeingAskedForWhereThereIsNothingElse) {
  const support::Nginx nginx(path("site"));
  expectLocalPicturesFrom(nginx.url() + "/tower/", "published");
  expectLocalPicturesFrom(serve(scene_).url, "served");
  expectLocalPicturesFrom(serve(nginx.url() + "/tower", {"--cache", path("cache")}).url, "far");
  expectLocalPicturesFrom(scene_, "folder");
}

TEST_P(StreamedPiecesTest, refusesOtherMethodsWithTheReason) {
  const support::Nginx nginx(path("site"));
  for (const std::string& url : {serve(scene_).url, nginx.url() + "/tower/", scene_})
    expectOneLineError(view(url, {"--method", "patches"}), 1, {"--method " + name()});
  for (const std::string& url : {serve(scene_).url, nginx.url() + "/tower/", scene_})
    expectOneLineError(view(url, {"--method", "qsplat"}), 1, {"has no splats", "--methods qsplat"});
  EXPECT_EQ(view(scene_, GetParam().too_fine).status, 2);
}

TEST_P(StreamedPiecesTest, samplesAndSizeAreOptions) {
  const Tour fine = tour(scene_, "fine", name());
  const Tour coarse = tour(scene_, "coarse", name(), GetParam().coarse);
  EXPECT_EQ(fine.lines.front()["samples_per_pixel"], 4);
  const std::string& figures = GetParam().figures;
  EXPECT_LT(4 * coarse.lines.front()[figures]["triangles"].get<int>(),
            fine.lines.front()[figures]["triangles"].get<int>());
  EXPECT_NE(coarse.pictures.front().pixels, fine.pictures.front().pixels);
}

class HlodShadows : public StreamedPiecesTest {
 protected:
  /// A viewer's maps serve several views, and have less memory, so that its views are divided into slices sooner: edges
  /// of shadows are off by parts of a pixel.
  void expectNearLocalPictures(const Tour& seen, const std::vector<std::string>& light) {
    for (std::size_t i = 0; i < seen.pictures.size(); ++i) {
      const base::Image local = localPicture(i, name(), light);
      ASSERT_EQ(seen.pictures[i].pixels.size(), local.pixels.size());
      double sum = 0.0;
      std::size_t apart = 0;
      for (std::size_t k = 0; k < local.pixels.size(); ++k) {
        const int difference = std::abs(local.pixels[k] - seen.pictures[i].pixels[k]);
        sum += difference;
        apart += difference > 24 ? 1 : 0;
      }
      const auto all = static_cast<double>(local.pixels.size());
      EXPECT_LT(sum / all, 0.5) << "frame " << i;
      EXPECT_LT(static_cast<double>(apart) / all, 0.01) << "frame " << i;
    }
  }
};

INSTANTIATE_TEST_SUITE_P(Of, HlodShadows, ::testing::Values(hlod()), nameOfMethod);

TEST_P(HlodShadows, areThoseOfLumigridRender) {
  const support::Nginx nginx(path("site"));
  const std::vector<std::vector<std::string>> lights{{"--shadows", "hard", "--light-direction", "1,0.3,0.3"},
                                                     {"--shadows", "soft", "--light-direction", "-1,0.3,0.3"},
                                                     {"--shadows", "hard", "--light-position", "-2,0,0.7"}};
  for (const std::vector<std::string>& light : lights) {
    std::vector<std::string> options = light;
    options.emplace_back("--no-antialias");
    const Tour seen = tour(nginx.url() + "/tower/", light[1] + light[3], name(), options);
    expectNearLocalPictures(seen, light);
    EXPECT_EQ(seen.lines.front()["hlod"]["shadows"], light[1]);
    EXPECT_GT(seen.lines.front()["hlod"]["casters"], 0);
  }
  for (const auto& [more, named] :
       {std::pair(std::vector<std::string>{"--shadows", "mild"}, "none, hard or soft"),
        {{"--shadows", "hard", "--light", "0,20", "--light-direction", "1,0,1"}, "--light is a light, too"},
        {{"--light-size", "3"}, "--shadows hard or soft"}}) {
    std::vector<std::string> options{"--method", name()};
    options.insert(options.end(), more.begin(), more.end());
    expectOneLineError(view(scene_, options), 2, {named});
  }
  expectOneLineError(view(scene_, {"--method", "pmr", "--shadows", "hard"}), 2, {"--method hlod"});
}

TEST_P(StreamedPiecesTest, aFileThatIsCutOrAnotherOneIsNamed) {
  const support::Nginx nginx(path("site"));
  std::string file;
  for (const auto& entry : fs::directory_iterator(path("site/tower")))
    if (entry.path().extension() == extension()) file = entry.path().string();
  const std::string bytes = readText(file);
  writeText(file, bytes.substr(0, bytes.size() / 2));
  for (const std::string& url : {nginx.url() + "/tower/", path("site/tower")})
    expectOneLineError(view(url, {"--method", name()}), 1, {extension()});
  writeText(file, "no points" + bytes.substr(9));
  for (const std::string& url : {nginx.url() + "/tower/", path("site/tower")})
    expectOneLineError(view(url, {"--method", name()}), 1, {extension()});
  fs::remove(file);
  expectOneLineError(view(nginx.url() + "/tower/", {"--method", name()}), 1, {extension(), "is not there"});
}

}  // namespace
