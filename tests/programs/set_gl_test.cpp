// `lumigrid set` changes how a scene is shown, and names what must be drawn again.
#include <signal.h>

#include <chrono>
#include <cmath>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <thread>

#include "base/json/scene_file.h"
#include "base/png/png.h"
#include "tests/programs/face_values.h"
#include "tests/programs/run_program.h"
#include "tests/server/net/loopback.h"

namespace {

using nlohmann::json;
using programs::faceValues;
using programs::run;

class Set : public programs::ProgramTest {
 protected:
  std::uint16_t serve(const std::string& scene) {
    server_ = programs::start("lumigrid", {"serve", scene, "--port", "0", "--json"}, path("serve"));
    int port = 0;
    EXPECT_TRUE(eventually([&] {
      const json told = json::parse(programs::readText(path("serve.out")), nullptr, false);
      if (!told.is_object()) return false;
      const std::string url = told["url"];
      port = std::stoi(url.substr(url.rfind(':') + 1));
      return true;
    })) << programs::readText(path("serve.err"));
    return static_cast<std::uint16_t>(port);
  }
  void stopServer() {
    ::kill(server_, SIGTERM);
    EXPECT_EQ(programs::wait(server_), 0) << programs::readText(path("serve.err"));
    server_ = 0;
  }
  void TearDown() override {
    if (server_ > 0) stopServer();
    ProgramTest::TearDown();
  }
  /// Asks again and again until it is so, for a minute.
  static bool eventually(const std::function<bool()>& is_so) {
    for (int i = 0; i < 600; ++i) {
      if (is_so()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    return false;
  }

 private:
  pid_t server_ = 0;
};

TEST_F(Set, howASceneIsShownIsSetWithoutBuildingItAgain) {
  const std::string scene = smallScene();
  const auto images = faceValues(scene);
  const std::string hash = programs::readText(scene + "/patch.lgp");
  const auto set = run("lumigrid", {"set", scene, "--up", "-y", "--units", "mm", "--title", "The small one"});
  ASSERT_EQ(set.status, 0) << set.err;
  const auto changed = base::readScene(scene);
  ASSERT_TRUE(changed) << changed.error().message;
  EXPECT_EQ(changed->up, glm::dvec3(0.0, -1.0, 0.0));
  EXPECT_EQ(changed->units, "mm");
  EXPECT_EQ(changed->title, "The small one");
  EXPECT_EQ(faceValues(scene), images);
  EXPECT_EQ(programs::readText(scene + "/patch.lgp"), hash);
  EXPECT_EQ(run("lumigrid", {"build", "-o", scene, "--missing"}).status, 0);
  EXPECT_EQ(run("lumigrid", {"verify", scene}).status, 0);

  // One thing at a time leaves the others.
  ASSERT_EQ(run("lumigrid", {"set", scene, "--title", ""}).status, 0);
  const auto untitled = base::readScene(scene);
  ASSERT_TRUE(untitled);
  EXPECT_EQ(untitled->title, "");
  EXPECT_EQ(untitled->units, "mm");
  EXPECT_EQ(untitled->up, changed->up);

  // The first view: a permalink, one in a file, or the side that shows most.
  ASSERT_TRUE(untitled->start_direction.has_value());
  const std::string link = "v=1&p=1,2,3&a=-120.5,-20&r=12.5";
  ASSERT_EQ(run("lumigrid", {"set", scene, "--start-view", link}).status, 0);
  EXPECT_EQ(base::readScene(scene)->start_view, link);
  programs::writeText(path("view.txt"), "https://example.org/scans/#" + link + "\n");
  ASSERT_EQ(run("lumigrid", {"set", scene, "--start-view", path("view.txt")}).status, 0);
  EXPECT_EQ(base::readScene(scene)->start_view, link);
  ASSERT_EQ(run("lumigrid", {"set", scene, "--start-view", "auto"}).status, 0);
  EXPECT_EQ(base::readScene(scene)->start_view, "");
  programs::expectOneLineError(run("lumigrid", {"set", scene, "--start-view", "from above"}), 1, {"permalink"});
  ASSERT_EQ(run("lumigrid", {"set", scene, "--start-view", "v=1&x=z,0.5,b"}).status, 0);
  EXPECT_EQ(base::readScene(scene)->start_view, "v=1&x=z,0.5,b");
  ASSERT_EQ(run("lumigrid", {"set", scene, "--start-view", ""}).status, 0);
  EXPECT_EQ(base::readScene(scene)->start_view, "");

  programs::expectOneLineError(
      run("lumigrid", {"set", scene}), 2,
      {"--up", "--north", "--units", "--crs", "--title", "--attribution", "--background", "--start-view", "--light"});
  EXPECT_EQ(run("lumigrid", {"set", scene, "--up", "w"}).status, 2);
  programs::expectOneLineError(run("lumigrid", {"set", path("nothing"), "--up", "z"}), 1, {"nothing", "scene"});
  EXPECT_FALSE(std::filesystem::exists(path("nothing")));
}

TEST_F(Set, everythingThatIsSetIsToldByInfoAndTakenAwayByAnEmptyText) {
  const std::string scene = smallScene();
  const std::map<std::string, std::string> options{{"--north", "-12.5"},
                                                   {"--units", "m"},
                                                   {"--crs", "EPSG:32718"},
                                                   {"--title", "The <tower>"},
                                                   {"--attribution", "A. Nonymous & S\u00F6hne"},
                                                   {"--background", "20,40,255"}};
  std::vector<std::string> set{"set", scene, "--up", "z"}, clear{"set", scene};
  for (const auto& [option, value] : options) {
    set.insert(set.end(), {option, value});
    clear.insert(clear.end(), {option, ""});
  }
  const auto infoOf = [&] { return json::parse(run("lumigrid", {"info", scene, "--json"}).out); };
  const json before = infoOf();
  const auto done = run("lumigrid", set);
  ASSERT_EQ(done.status, 0) << done.err;
  EXPECT_EQ(done.err, "");
  const json after = infoOf();
  const json& told = after["scene"];
  EXPECT_EQ(told["north"], -12.5);
  EXPECT_NEAR(after["north_direction"][1].get<double>(), std::cos(glm::radians(12.5)), 1e-9);
  EXPECT_NEAR(after["north_direction"][0].get<double>(), -std::sin(glm::radians(12.5)), 1e-9);
  EXPECT_EQ(told["units"], "m");
  EXPECT_EQ(told["crs"], "EPSG:32718");
  EXPECT_EQ(told["title"], "The <tower>");
  EXPECT_EQ(told["attribution"], "A. Nonymous & S\u00F6hne");
  EXPECT_EQ(told["background"], "#1428ff");
  const std::string text = run("lumigrid", {"info", scene}).out;
  for (const char* piece : {"EPSG:32718", "The <tower>", "A. Nonymous & S\u00F6hne", "#1428ff", "-12.5 degrees"})
    EXPECT_NE(text.find(piece), std::string::npos) << piece;

  // A wrong value changes nothing, not even what is right beside it.
  for (const auto& [option, value] :
       {std::pair("--north", "north"), std::pair("--north", "361"), std::pair("--crs", "32718"),
        std::pair("--background", "blue"), std::pair("--background", "1,2,256"), std::pair("--background", "1,2,3,"),
        std::pair("--attribution", "a\nb"), std::pair("--title", "\xFF"), std::pair("--units", "a\tb"),
        std::pair("--start-view", "v=1&p=1,2,3&a=4,5")})
    programs::expectOneLineError(run("lumigrid", {"set", scene, option, value, "--up", "x"}), 1, {option});
  EXPECT_EQ(infoOf(), after);

  ASSERT_EQ(run("lumigrid", clear).status, 0);
  const json cleared = infoOf();
  for (const char* member : {"north", "crs", "title", "attribution", "background"})
    EXPECT_FALSE(cleared["scene"].contains(member)) << member;
  EXPECT_EQ(cleared["scene"]["units"], "unknown");
  EXPECT_FALSE(cleared.contains("north_direction"));
  EXPECT_EQ(cleared["images"], before["images"]);
}

TEST_F(Set, twelveOrientationsLookAtTheModelWithTheirAxisUp) {
  const std::string scene = smallScene();
  const auto images = faceValues(scene);
  const base::Scene built = *base::readScene(scene);
  for (const std::string axis : {"x", "y", "z", "-x", "-y", "-z"})
    for (const std::string degrees : {"0", "135"}) {
      ASSERT_EQ(run("lumigrid", {"set", scene, "--up", axis, "--north", degrees}).status, 0);
      const auto read = base::readScene(scene);
      ASSERT_TRUE(read) << read.error().message;
      EXPECT_EQ(read->up[axis.back() - 'x'], axis.size() == 1 ? 1.0 : -1.0);
      EXPECT_NEAR(glm::length(read->up), 1.0, 1e-12);
      const glm::dvec3 north = base::northOf(*read);
      EXPECT_NEAR(glm::dot(north, read->up), 0.0, 1e-9);
      EXPECT_NEAR(glm::length(north), 1.0, 1e-9);
      // The first view looks from somewhere aside, so that its camera can stand upright.
      ASSERT_TRUE(read->start_direction);
      EXPECT_LT(std::abs(glm::dot(*read->start_direction, read->up)), 0.99) << axis;
      EXPECT_FALSE(built.hull.empty());
      EXPECT_EQ(read->hull, built.hull) << "it has no up";
      EXPECT_EQ(read->light, built.light) << "images were drawn in it";
    }
  EXPECT_EQ(faceValues(scene), images);
  EXPECT_EQ(run("lumigrid", {"build", "-o", scene, "--missing"}).status, 0);
}

TEST_F(Set, imagesOfAnotherLightAreNamedAndDrawnAgain) {
  const std::string scene = path("scene");
  const auto first = run("lumigrid", {"build", smallMesh(), "-o", scene, "--grid", "3", "--face", "64", "--normals",
                                      "vertices", "--quiet"});
  ASSERT_EQ(first.status, 0) << first.err;
  const auto drawn = faceValues(scene);
  const bool is_unlit = base::readScene(scene)->light.mode == base::LightMode::kUnlit;
  const std::string own = is_unlit ? "unlit" : "soft", other = is_unlit ? "soft" : "unlit";
  const auto setLight = [&](const std::string& light) { return run("lumigrid", {"set", scene, "--light", light}); };
  const auto missing = [&] {
    const auto told = run("lumigrid", {"build", "-o", scene, "--missing", "--json"});
    return std::pair(told.status, json::parse(told.out));
  };

  // The light that is there already is no change.
  EXPECT_EQ(setLight(own).err, "");
  EXPECT_EQ(missing().first, 0);
  programs::expectOneLineError(setLight(other), 0, {own, "lumigrid build -o " + scene});
  EXPECT_EQ(setLight(other).err, "") << "it is said once";
  EXPECT_EQ(faceValues(scene), drawn) << "images are removed when new ones are drawn, not before";
  EXPECT_EQ(base::readScene(scene)->images_light->mode, is_unlit ? base::LightMode::kUnlit : base::LightMode::kSoft);
  const auto [status, named] = missing();
  EXPECT_EQ(status, 3);
  EXPECT_EQ(named["missing_faces"], drawn.size());
  EXPECT_EQ(named["images_light"], own);
  EXPECT_EQ(named["hierarchy"], "complete");
  EXPECT_NE(run("lumigrid", {"build", "-o", scene, "--missing"}).out.find("drawn " + own), std::string::npos);
  EXPECT_EQ(json::parse(run("lumigrid", {"info", scene, "--json"}).out)["images"]["to_draw_again"], drawn.size());
  EXPECT_NE(run("lumigrid", {"info", scene}).out.find("drawn " + own), std::string::npos);
  EXPECT_EQ(run("lumigrid", {"verify", scene}).status, 0);

  // Set back, all is right again, and nothing is drawn.
  EXPECT_EQ(setLight(own).err, "");
  EXPECT_EQ(missing().first, 0);
  const auto idle = run("lumigrid", {"build", "-o", scene, "--json", "--quiet"});
  ASSERT_EQ(idle.status, 0) << idle.err;
  EXPECT_EQ(json::parse(idle.out)["images"]["rendered"], 0);

  ASSERT_EQ(setLight(other).status, 0);
  const auto built = run("lumigrid", {"build", "-o", scene, "--json", "--quiet"});
  ASSERT_EQ(built.status, 0) << built.err;
  EXPECT_EQ(json::parse(built.out)["images"]["rendered"], drawn.size());
  EXPECT_EQ(missing().first, 0);
  EXPECT_FALSE(base::readScene(scene)->images_light);
  EXPECT_EQ(run("lumigrid", {"verify", scene}).status, 0);
  const auto redrawn = faceValues(scene);
  EXPECT_EQ(redrawn.size(), drawn.size());
  EXPECT_NE(redrawn, drawn);

  // The images are those of a scene that was built in this light from the beginning.
  const std::string whole = path("whole");
  ASSERT_EQ(
      run("lumigrid", {"build", smallMesh(), "-o", whole, "--grid", "3", "--face", "64", "--light", other, "--quiet"})
          .status,
      0);
  EXPECT_EQ(faceValues(whole), redrawn);
}

TEST_F(Set, imagesOfAnotherSunAreDrawnAgain) {
  const std::string scene = path("scene"), whole = path("whole");
  const auto build = [&](const std::string& output, std::vector<std::string> options) {
    options.insert(options.begin(), {"build", smallMesh(), "-o", output, "--grid", "2", "--face", "64", "--quiet"});
    return run("lumigrid", options);
  };
  const std::vector<std::string> morning{"--methods",         "patch,images,hlod", "--light",      "soft-shadows",
                                         "--light-direction", "-1,0.5,0.25",       "--light-size", "3"};
  programs::expectOneLineError(build(scene, {"--light", "soft-shadows"}), 2, {"--methods hlod"});
  programs::expectOneLineError(build(scene, {"--light", "unlit", "--light-size", "3"}), 2, {"soft-shadows"});
  ASSERT_EQ(build(scene, morning).status, 0);
  const auto drawn = faceValues(scene);
  const auto built = base::readScene(scene);
  ASSERT_TRUE(built) << built.error().message;
  EXPECT_EQ(built->light.mode, base::LightMode::kSoftShadows);
  EXPECT_EQ(built->light.size, 3.0);
  EXPECT_LT(glm::length(built->light.direction - glm::normalize(glm::vec3(-1.0F, 0.5F, 0.25F))), 1e-6F);
  EXPECT_EQ(run("lumigrid", {"verify", scene}).status, 0);
  EXPECT_NE(run("lumigrid", {"info", scene}).out.find("light: soft-shadows"), std::string::npos);

  // The same command, and one without meshes, have nothing to do.
  for (const auto& again : {build(scene, morning), run("lumigrid", {"build", "-o", scene, "--quiet"})})
    EXPECT_EQ(again.status, 0) << again.err;
  EXPECT_EQ(faceValues(scene), drawn);

  programs::expectOneLineError(run("lumigrid", {"set", scene, "--light-direction", "1,0.5,0.25"}), 0,
                               {"drawn, soft-shadows", "lumigrid build -o " + scene});
  EXPECT_EQ(base::readScene(scene)->images_light, built->light);
  EXPECT_EQ(run("lumigrid", {"build", "-o", scene, "--missing"}).status, 3);
  ASSERT_EQ(run("lumigrid", {"build", "-o", scene, "--quiet"}).status, 0);
  EXPECT_EQ(run("lumigrid", {"build", "-o", scene, "--missing"}).status, 0);
  const auto evening = faceValues(scene);
  EXPECT_NE(evening, drawn);

  // The images are those of a scene that was built in this light from the beginning.
  std::vector<std::string> in_evening = morning;
  in_evening[5] = "1,0.5,0.25";
  ASSERT_EQ(build(whole, in_evening).status, 0);
  EXPECT_EQ(faceValues(whole), evening);

  // A light that was moved, and whose images are not drawn yet, stays where it is where only its kind is named again.
  programs::expectOneLineError(run("lumigrid", {"set", scene, "--light-position", "0.5,3,0.5", "--light-size", "0.2"}),
                               0, {"drawn"});
  ASSERT_EQ(run("lumigrid", {"set", scene, "--light", "soft-shadows"}).status, 0);
  EXPECT_EQ(base::readScene(scene)->light.position, glm::dvec3(0.5, 3.0, 0.5));
  ASSERT_EQ(run("lumigrid", {"build", "-o", scene, "--quiet"}).status, 0);
  const auto lamp = faceValues(scene);
  EXPECT_NE(lamp, evening);
  std::vector<std::string> at_the_lamp = morning;
  at_the_lamp[4] = "--light-position", at_the_lamp[5] = "0.5,3,0.5", at_the_lamp[7] = "0.2";
  const std::string lit = path("lit");
  ASSERT_EQ(build(lit, at_the_lamp).status, 0);
  EXPECT_EQ(faceValues(lit), lamp);
  EXPECT_EQ(build(lit, at_the_lamp).status, 0);

  // Without the octree there are no shadows.
  ASSERT_EQ(build(path("plain"), {"--methods", "patch"}).status, 0);
  programs::expectOneLineError(run("lumigrid", {"set", path("plain"), "--light", "hard-shadows"}), 1, {"hlod"});
  EXPECT_FALSE(base::readScene(path("plain"))->light.hasShadows());
}

TEST_F(Set, lightOnPatchesWithoutNormalsSaysWhatMayShow) {
  const std::string scene = path("scene");
  ASSERT_EQ(run("lumigrid", {"build", smallMesh(), "-o", scene, "--methods", "patch", "--quiet"}).status, 0);
  programs::expectOneLineError(run("lumigrid", {"set", scene, "--light", "soft"}), 0, {"edges", "--normals vertices"});
  EXPECT_EQ(run("lumigrid", {"set", scene, "--light", "unlit"}).err, "");
}

TEST_F(Set, shardsOfAnotherLightAreDrawnAgainShardByShard) {
  const std::string scene = path("scene");
  ASSERT_EQ(run("lumigrid", {"build", smallMesh(), "-o", scene, "--grid", "3", "--face", "64", "--shards", "3",
                             "--light", "unlit", "--quiet"})
                .status,
            0);
  ASSERT_EQ(run("lumigrid", {"set", scene, "--light", "soft"}).status, 0);
  const auto missing = [&] { return json::parse(run("lumigrid", {"build", "-o", scene, "--missing", "--json"}).out); };
  EXPECT_EQ(missing()["missing_shards"], "0-2");
  ASSERT_EQ(run("lumigrid", {"build", "-o", scene, "--shard", "1/3", "--quiet"}).status, 0);
  EXPECT_EQ(missing()["missing_shards"], "0,2");
  ASSERT_EQ(run("lumigrid", {"build", "-o", scene, "--quiet"}).status, 0);
  EXPECT_EQ(missing()["complete"], true);
  EXPECT_EQ(run("lumigrid", {"verify", scene}).status, 0);
}

TEST_F(Set, aRunningServerTakesUpWhatIsSet) {
  const std::string scene = smallScene();
  ASSERT_EQ(run("lumigrid", {"set", scene, "--light", "unlit"}).status, 0);
  const std::uint16_t port = serve(scene);
  ASSERT_EQ(run("lumigrid", {"set", scene, "--title", "The <tower>", "--attribution", "A. <b> & Co.", "--north", "90",
                             "--crs", "EPSG:32718", "--background", "#0000ff"})
                .status,
            0);
  const auto served = [&] { return json::parse(server::httpRequest(port, "/scene.json").body, nullptr, false); };
  EXPECT_TRUE(eventually([&] { return served().value("attribution", "") == "A. <b> & Co."; }));
  EXPECT_EQ(served()["north"], 90.0);
  EXPECT_EQ(served()["crs"], "EPSG:32718");
  EXPECT_EQ(served()["background"], "#0000ff");

  // Pictures of the server follow the light.
  const base::Scene read = *base::readScene(scene);
  const glm::dvec3 middle = 0.5 * (read.box_min + read.box_max), size = read.box_max - read.box_min;
  const auto text = [](const glm::dvec3& v) {
    return std::to_string(v.x) + "," + std::to_string(v.y) + "," + std::to_string(v.z);
  };
  const std::string view = "/render?position=" + text(middle + glm::dvec3(1.5, -2.0, 1.0) * glm::length(size)) +
                           "&target=" + text(middle) + "&up=0,0,1&width=80&height=60&supersampling=1";
  const auto picture = [&] {
    const std::string png = server::httpRequest(port, view).body;
    return base::decodePng(base::viewOfText(png));
  };
  const auto unlit = picture();
  ASSERT_TRUE(unlit) << unlit.error().message;
  ASSERT_EQ(run("lumigrid", {"set", scene, "--light", "soft"}).status, 0);
  EXPECT_TRUE(eventually([&] {
    const auto lit = picture();
    return lit && lit->pixels != unlit->pixels;
  })) << "the server goes on drawing in the light that it was started with";
  EXPECT_EQ(served()["light"]["mode"], "soft");
}

TEST_F(Set, selectedPointsAreKeptForImagesOfAnotherLight) {
  // A new selection would want the scene whose viewers it was made for.
  const std::string seen = smallScene(), scene = path("selected");
  const std::uint16_t port = serve(seen);
  ASSERT_EQ(run("lumigrid", {"tour", seen, "--frames", "1", "--size", "160", "90", "-o", path("tour.json")}).status, 0);
  ASSERT_EQ(run("lumigrid-view", {"ws://127.0.0.1:" + std::to_string(port) + "/", "--headless", "--path",
                                  path("tour.json"), "--out", path("tour")})
                .status,
            0);
  stopServer();
  ASSERT_EQ(run("lumigrid", {"build", smallMesh(), "-o", scene, "--grid", "9", "--face", "32", "--views", "50",
                             "--views-from", seen, "--light", "unlit", "--quiet"})
                .status,
            0);
  const auto drawn = faceValues(scene);
  std::filesystem::remove_all(seen);
  ASSERT_EQ(run("lumigrid", {"set", scene, "--light", "soft"}).status, 0);
  const json missing = json::parse(run("lumigrid", {"build", "-o", scene, "--missing", "--json"}).out);
  EXPECT_EQ(missing["missing_faces"], drawn.size());
  EXPECT_FALSE(missing.contains("sampling_points"));
  const auto built = run("lumigrid", {"build", "-o", scene, "--quiet"});
  ASSERT_EQ(built.status, 0) << built.err;
  EXPECT_EQ(run("lumigrid", {"build", "-o", scene, "--missing"}).status, 0);
  const auto redrawn = faceValues(scene);
  ASSERT_EQ(redrawn.size(), drawn.size());
  for (const auto& [key, value] : drawn) EXPECT_TRUE(redrawn.contains(key));
}

}  // namespace
