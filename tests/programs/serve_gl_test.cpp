// Server and viewer run as processes and make the tour that ./demo makes.
#include <signal.h>

#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <thread>

#include "base/format_text.h"
#include "base/png/png.h"
#include "compare/accuracy.h"
#include "tests/programs/run_program.h"

namespace {

using nlohmann::json;
using programs::run;

class Serve : public programs::ProgramTest {
 protected:
  pid_t serve(const std::string& scene, std::string& url) {
    const pid_t pid = programs::start("lumigrid", {"serve", scene, "--port", "0", "--json"}, path("serve"));
    for (int i = 0; i < 2000 && url.empty(); ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
      const json j = json::parse(programs::readText(path("serve.out")), nullptr, false);
      if (j.is_object()) url = j["url"];
    }
    EXPECT_FALSE(url.empty()) << programs::readText(path("serve.err"));
    return pid;
  }
};

TEST_F(Serve, aTourShowsTheModelAndTheServerStopsOnSigterm) {
  const std::string scene = smallScene();
  std::string url;
  const pid_t server = serve(scene, url);
  ASSERT_EQ(run("lumigrid", {"tour", scene, "--frames", "3", "--size", "320", "180", "-o", path("tour.json")}).status,
            0);
  const auto viewed = run("lumigrid-view", {url, "--headless", "--path", path("tour.json"), "--out", path("tour")});
  EXPECT_EQ(viewed.status, 0) << viewed.err;

  for (int frame = 0; frame < 3; ++frame) {
    char name[32];
    std::snprintf(name, sizeof(name), "tour/frame_%04d.png", frame);
    auto image = base::readPng(path(name));
    ASSERT_TRUE(image) << image.error().message;
    EXPECT_EQ(image->width, 320);
    std::size_t covered = 0;
    for (std::size_t i = 3; i < image->pixels.size(); i += 4) covered += image->pixels[i] >= 128 ? 1U : 0U;
    EXPECT_GT(covered, 320U * 180U / 20U) << "the model is not in the picture";
    EXPECT_LT(covered, 320U * 180U) << "there is no background";
  }
  std::istringstream lines(programs::readText(path("tour/frames.jsonl")));
  int count = 0;
  for (std::string line; std::getline(lines, line); ++count) {
    const json j = json::parse(line, nullptr, false);
    ASSERT_TRUE(j.is_object()) << line;
    EXPECT_TRUE(j["complete"].get<bool>()) << line;
  }
  EXPECT_EQ(count, 3);

  ::kill(server, SIGTERM);
  EXPECT_EQ(programs::wait(server), 0) << programs::readText(path("serve.err"));
}

TEST_F(Serve, pageFilesAndPicturesThatCannotBeAreNamed) {
  const std::string scene = smallScene();
  const auto serveWith = [&](const std::string& option, const std::string& value) {
    return run("lumigrid", {"serve", scene, "--port", "0", "--no-access", "--no-frames", option, value});
  };
  programs::expectOneLineError(serveWith("--web", path("none")), 1, {path("none")});
  programs::expectOneLineError(serveWith("--web", scene), 1, {scene, "index.html", "--web"});
  EXPECT_EQ(serveWith("--max-picture", "-1").status, 2);
  EXPECT_EQ(serveWith("--max-picture", "much").status, 2);
  EXPECT_EQ(serveWith("--max-waiting-pictures", "-1").status, 2);
}

TEST_F(Serve, renderWritesTheGroundTruthAtAnySize) {
  const std::string scene = smallScene();
  ASSERT_EQ(run("lumigrid", {"tour", scene, "--frames", "1", "-o", path("tour.json")}).status, 0);
  json camera = json::parse(programs::readText(path("tour.json")))["frames"][0];
  programs::writeText(path("camera.json"), camera.dump());
  for (const char* method : {"full", "patches"}) {
    const auto rendered = run("lumigrid", {"render", scene, "--camera", path("camera.json"), "--method", method,
                                           "--size", "333x211", "--supersampling", "2", "-o", path("x.png")});
    ASSERT_EQ(rendered.status, 0) << rendered.err;
    auto image = base::readPng(path("x.png"));
    ASSERT_TRUE(image);
    EXPECT_EQ(image->width, 333);
    EXPECT_EQ(image->height, 211);
  }
}

TEST_F(Serve, renderDrawsSplatsOnceTheSceneHasThem) {
  const std::string scene = smallScene();
  ASSERT_EQ(run("lumigrid", {"tour", scene, "--frames", "1", "-o", path("tour.json")}).status, 0);
  programs::writeText(path("camera.json"), json::parse(programs::readText(path("tour.json")))["frames"][0].dump());
  const auto render = [&](const std::vector<std::string>& options) {
    std::vector<std::string> words{"render", scene, "--camera", path("camera.json"), "--size",
                                   "160",    "120", "-o",       path("x.png")};
    words.insert(words.end(), options.begin(), options.end());
    return run("lumigrid", words);
  };
  programs::expectOneLineError(render({"--method", "qsplat"}), 1, {scene, "--methods qsplat"});
  ASSERT_EQ(run("lumigrid", {"build", smallMesh(), "-o", scene, "--methods", "qsplat", "--quiet"}).status, 0);

  ASSERT_EQ(render({"--method", "full"}).status, 0);
  const auto truth = base::readPng(path("x.png"));
  ASSERT_TRUE(truth);
  std::set<std::string> pictures;
  for (const char* kernel : {"square", "circle", "fuzzy", "ellipse"}) {
    const auto drawn = render({"--method", "qsplat", "--splat", kernel, "--cutoff", "3"});
    ASSERT_EQ(drawn.status, 0) << drawn.err;
    EXPECT_NE(drawn.out.find("splats"), std::string::npos) << drawn.out;
    const auto picture = base::readPng(path("x.png"));
    ASSERT_TRUE(picture);
    const auto accuracy = compare::measureAccuracy(*truth, *picture);
    ASSERT_TRUE(accuracy) << accuracy.error().message;
    EXPECT_GT(accuracy->psnr_db, 15.0) << kernel;
    pictures.insert(programs::readText(path("x.png")));
  }
  EXPECT_EQ(pictures.size(), 4U) << "each kernel has its own look";
  EXPECT_EQ(render({"--method", "qsplat", "--splat", "round"}).status, 2);
  EXPECT_EQ(render({"--method", "qsplat", "--cutoff", "-1"}).status, 2);
}

// A viewer leads to the next build: the server counts the faces that it sends, and points are selected for views from
// there.
TEST_F(Serve, aSceneIsSampledWhereAViewerWas) {
  const std::string scene = smallScene();
  std::string url;
  const pid_t server = serve(scene, url);
  ASSERT_EQ(run("lumigrid", {"tour", scene, "--frames", "1", "--size", "160", "90", "-o", path("tour.json")}).status,
            0);
  ASSERT_EQ(run("lumigrid-view", {url, "--headless", "--path", path("tour.json"), "--out", path("tour")}).status, 0);
  ::kill(server, SIGTERM);
  ASSERT_EQ(programs::wait(server), 0) << programs::readText(path("serve.err"));

  const auto points = [&](const std::string& name, std::vector<std::string> more) {
    std::vector<std::string> words{"build", smallMesh(), "-o", path(name), "--grid", "9", "--face", "32", "--quiet"};
    words.insert(words.end(), more.begin(), more.end());
    const auto built = run("lumigrid", words);
    EXPECT_EQ(built.status, 0) << built.err;
    EXPECT_EQ(run("lumigrid", {"verify", path(name)}).status, 0);
    const json info = json::parse(run("lumigrid", {"info", path(name), "--json"}).out, nullptr, false);
    return info["images"]["points"].get<std::uint64_t>();
  };
  // One viewer at one place needs fewer points than viewers anywhere.
  const std::uint64_t anywhere = points("anywhere", {"--views", "100"});
  const std::uint64_t visited = points("visited", {"--views", "100", "--views-from", scene});
  EXPECT_LT(visited, anywhere);
  EXPECT_GT(visited, 8U);
  // A finished scene is looked over without the scene that its views were drawn from.
  std::filesystem::remove_all(scene);
  EXPECT_EQ(run("lumigrid", {"build", "-o", path("visited"), "--quiet"}).status, 0);

  programs::expectOneLineError(
      run("lumigrid", {"build", smallMesh(), "-o", path("x"), "--views", "30", "--views-from", scene, "--quiet"}), 1,
      {"--views-from", scene});
  programs::expectOneLineError(run("lumigrid", {"build", smallMesh(), "-o", path("y"), "--views-from", scene}), 2,
                               {"--views-from", "--views"});
}

TEST_F(Serve, withoutAPathTheFirstViewIsDrawn) {
  const std::string scene = smallScene();
  const auto picture = [&](std::vector<std::string> words) {
    std::filesystem::remove(path("serve.out"));
    std::string url;
    const pid_t server = serve(scene, url);
    words.insert(words.begin(), {url, "--headless", "--out", path("first"), "--size", "160x120"});
    const auto seen = run("lumigrid-view", words);
    ::kill(server, SIGTERM);
    EXPECT_EQ(programs::wait(server), 0);
    EXPECT_EQ(seen.status, 0) << seen.err;
    EXPECT_NE(seen.out.find("frame 1 of 1"), std::string::npos) << seen.out;
    return programs::readText(path("first/frame_0000.png"));
  };
  const std::string whole = picture({"--method", "patches"});
  const auto image = base::readPng(path("first/frame_0000.png"));
  ASSERT_TRUE(image);
  EXPECT_EQ(image->width, 160);
  EXPECT_EQ(image->height, 120);
  const auto alpha = [&](int x, int y) { return image->pixels[static_cast<std::size_t>(4 * (160 * y + x) + 3)]; };
  EXPECT_EQ(alpha(80, 60), 255) << "the model is in the middle";
  for (int x = 0; x < 160; ++x) EXPECT_EQ(alpha(x, 0) + alpha(x, 119), 0) << "and all of it is in the picture";

  const json told = json::parse(run("lumigrid", {"info", scene, "--json"}).out, nullptr, false)["scene"];
  ASSERT_TRUE(told.is_object() && told.contains("box_max")) << told;
  const auto from = told["box_min"].get<std::vector<double>>(), to = told["box_max"].get<std::vector<double>>();
  const std::string link = base::formatText("v=1&p=%.3f,%.3f,%.3f&a=30,-80&r=2&f=50&m=patches", 0.5 * (from[0] + to[0]),
                                            0.5 * (from[1] + to[1]), to[2] + 2.0);
  const std::string above = picture({"--view", link});
  EXPECT_NE(above, whole);
  const std::string cut = base::formatText("&x=z,%.3f,b", 0.5 * (from[2] + to[2]));
  EXPECT_NE(picture({"--view", link + cut}), above) << "the link's section cuts";
  ASSERT_EQ(run("lumigrid", {"set", scene, "--start-view", link}).status, 0);
  EXPECT_EQ(picture({"--method", "patches"}), above) << "the scene's own first view";
  programs::expectOneLineError(
      run("lumigrid-view", {"ws://127.0.0.1:1/", "--headless", "--view", link, "--path", path("x.json")}), 2,
      {"--view", "--path"});
}

}  // namespace
