#include "base/json/scene_file.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <tuple>

#include "base/file.h"
#include "tests/support/temporary_directory.h"

namespace {

base::Scene example() {
  base::Scene scene;
  scene.sources.push_back({"a.ply", 12, "ab"});
  scene.box_min = {500000.125, 4000000.25, -3};
  scene.box_max = {500010.5, 4000020.75, 7};
  scene.origin = {500005, 4000010, 2};
  scene.units = "m";
  scene.light.mode = base::LightMode::kUnlit;
  scene.has_colors = true;
  scene.triangles = 3'000'000'000ULL;
  scene.repairs["welded_vertices"] = 4;
  scene.parameters["grid"] = "12";
  scene.parts.push_back({"patch.lgp", 77, "cd", {{0, 10}, {20, 7}}});
  scene.title = "The tower";
  scene.start_view = "v=1&p=1,2,3&a=4,5&r=6";
  scene.interior = true;
  scene.interior_grid = 31;
  scene.hull = {{500000.125, 4000000.25, -3}, {500010.5, 4000019.625, 6.5}};
  scene.north = -12.5;
  scene.crs = "EPSG:32718";
  scene.attribution = "A. Nonymous & S\u00F6hne <info@example.org>";
  scene.background = base::Rgb{20, 40, 255};
  scene.images_light = base::Light{base::LightMode::kSoftShadows, {0, 0.6F, 0.8F}, glm::dvec3(500001.5, 2, 3), 0.25};
  return scene;
}

TEST(SceneFile, survivesWritingAndReading) {
  const base::Scene scene = example();
  auto read = base::parseScene(base::formatScene(scene), "scene.json");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(base::formatScene(*read), base::formatScene(scene));
  EXPECT_EQ(read->box_min, scene.box_min);
  EXPECT_EQ(read->triangles, scene.triangles);
  EXPECT_EQ(read->parts[0].sha256, "cd");
  EXPECT_EQ(read->parts[0].opening, scene.parts[0].opening);
  EXPECT_TRUE(read->interior);
  EXPECT_EQ(read->interior_grid, scene.interior_grid);
  EXPECT_EQ(read->hull, scene.hull);
  EXPECT_EQ(read->north, scene.north);
  EXPECT_EQ(read->crs, scene.crs);
  EXPECT_EQ(read->attribution, scene.attribution);
  EXPECT_EQ(read->background, scene.background);
  EXPECT_EQ(read->images_light, scene.images_light);
}

TEST(SceneFile, appearanceThatNobodySetIsAbsent) {
  const std::string text = base::formatScene(base::Scene());
  for (const char* member : {"title", "start_view", "interior", "interior_grid", "hull", "north", "crs", "attribution",
                             "background", "images_light"})
    EXPECT_EQ(text.find(std::string("\"") + member + "\""), std::string::npos) << member;
  const auto read = base::parseScene(text, "s");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_FALSE(read->north || read->background || read->images_light || !read->hull.empty());
  EXPECT_EQ(base::northOf(*read), glm::dvec3(0.0));
}

TEST(SceneFile, lightsWithShadowsAreReadAsTheyWereWritten) {
  base::Scene scene = example();
  for (const base::Light& light :
       {base::Light{base::LightMode::kHardShadows, {0, 0, 1}, {}, 0.0},
        base::Light{base::LightMode::kHardShadows, {0, 0, 1}, glm::dvec3(500001.0625, -2, 1e3), 0.0},
        base::Light{base::LightMode::kSoftShadows, {0.6F, 0, 0.8F}, {}, 0.53}}) {
    scene.light = light;
    const auto read = base::parseScene(base::formatScene(scene), "s");
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(read->light, light);
  }
}

TEST(SceneFile, imagesLightMayBeTheModeAlone) {
  base::Scene scene = example();
  scene.images_light.reset();
  std::string text = base::formatScene(scene);
  text.insert(text.find('{') + 1, "\"images_light\": \"soft\",");
  const auto read = base::parseScene(text, "s");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->images_light, (base::Light{base::LightMode::kSoft, scene.light.direction, {}, 0.0}));
}

TEST(SceneFile, appearanceThatCannotBeIsNamed) {
  const std::string good = base::formatScene(example());
  for (const auto& [is, becomes, name] :
       {std::tuple("-12.5", "-361.0", "north"), std::tuple("-12.5", "\"N\"", "north"),
        std::tuple("\"#1428ff\"", "\"blue\"", "background"), std::tuple("\"#1428ff\"", "7", "background"),
        std::tuple("\"EPSG:32718\"", "32718", "crs"), std::tuple("\"soft-shadows\"", "\"dim\"", "images_light: mode"),
        std::tuple("\"size\": 0.25", "\"size\": 0", "images_light: size"),
        std::tuple("\"size\": 0.25", "\"size\": \"big\"", "images_light: size"),
        std::tuple("500001.5", "1e30", "images_light: position"), std::tuple("4000019.625,", "", "hull"),
        std::tuple("4000019.625", "null", "hull"), std::tuple("4000019.625", "1e300", "hull"),
        std::tuple("\"hull\": [", "\"hull\": 3, \"more\": [", "hull"),
        std::tuple("\"interior_grid\": 31", "\"interior_grid\": 1025", "interior_grid"),
        std::tuple("\"interior_grid\": 31", "\"interior_grid\": -1", "interior_grid"),
        std::tuple("\"opening\": [", "\"opening\": [3,", "opening"),
        std::tuple("\"opening\": [", "\"opening\": [[-3, 5],", "opening")}) {
    std::string text = good;
    ASSERT_NE(text.find(is), std::string::npos) << is;
    text.replace(text.find(is), std::string(is).size(), becomes);
    const auto read = base::parseScene(text, "s");
    ASSERT_FALSE(read) << becomes;
    EXPECT_NE(read.error().message.find(name), std::string::npos) << read.error().message;
  }
}

TEST(SceneFile, aHullHasAtMost32Points) {
  base::Scene scene = example();
  scene.hull.assign(base::kMaxHull, glm::dvec3(1, 2, 3));
  EXPECT_TRUE(base::parseScene(base::formatScene(scene), "s"));
  scene.hull.emplace_back(0.0);
  EXPECT_EQ(base::parseScene(base::formatScene(scene), "s").error().message,
            "s: hull is no list of at most 32 points; build the scene again");
}

TEST(SceneFile, aCoordinateReferenceSystemIsAnAuthorityAndItsCode) {
  for (const char* good : {"EPSG:32718", "OGC:CRS84", "EPSG:25832+7837", "urn:ogc:def:crs:EPSG::4978"})
    EXPECT_TRUE(base::isCrsName(good)) << good;
  for (const std::string bad : {"", "32718", "EPSG", "EPSG:", ":32718", "EPSG 32718", "EPSG:<b>", "3:4"})
    EXPECT_FALSE(base::isCrsName(bad)) << bad;
  EXPECT_FALSE(base::isCrsName("EPSG:" + std::string(60, '1')));
}

TEST(SceneFile, everyTruncationIsANamedError) {
  const std::string text = base::formatScene(example());
  for (std::size_t length = 0; length + 2 < text.size(); ++length) {
    auto read = base::parseScene(text.substr(0, length), "cut.json");
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().message.find("cut.json: "), 0U) << read.error().message;
  }
}

TEST(SceneFile, saysWhichFieldIsWrong) {
  std::string text = base::formatScene(example());
  text.replace(text.find("\"has_colors\": true"), 18, "\"has_colors\": 3");
  auto read = base::parseScene(text, "s");
  ASSERT_FALSE(read);
  EXPECT_NE(read.error().message.find("has_colors has the wrong type"), std::string::npos);
}

// Values of a wrong type that were once accepted here made `info` fail later.
TEST(SceneFile, repairsAndParametersAreObjectsOfOneType) {
  const std::string good = base::formatScene(example());
  const auto with = [&](const std::string& is, const std::string& becomes) {
    std::string text = good;
    return text.replace(text.find(is), is.size(), becomes);
  };
  for (const auto& [text, what] : {std::pair(with("\"welded_vertices\": 4", "\"welded_vertices\": \"4\""), "repairs"),
                                   std::pair(with("\"grid\": \"12\"", "\"grid\": 12"), "parameters"),
                                   std::pair(with("\"repairs\": {", "\"repairs\": \"x\", \"more\": {"), "repairs")}) {
    const auto read = base::parseScene(text, "s");
    ASSERT_FALSE(read) << text;
    EXPECT_EQ(read.error().message.find("s: " + std::string(what)), 0U) << read.error().message;
  }
}

// As a float it would be infinite, and written as null.
TEST(SceneFile, lightDirectionThatNoFloatHoldsIsRefused) {
  base::Scene scene = example();
  scene.light.direction = {0, 0, 0.5F};
  std::string text = base::formatScene(scene);
  text.replace(text.rfind("0.5"), 3, "1e300");
  const auto read = base::parseScene(text, "s");
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().message, "s: light: direction is too long; build the scene again");
}

TEST(SceneFile, refusesAnotherVersionByNumber) {
  std::string text = base::formatScene(example());
  text.replace(text.find("\"version\": 1"), 12, "\"version\": 9");
  auto read = base::parseScene(text, "s");
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().code, base::ErrorCode::kVersion);
}

TEST(SceneFile, directoryWithoutSceneSaysHowToMakeOne) {
  const support::TemporaryDirectory directory;
  auto read = base::readScene(directory.path());
  ASSERT_FALSE(read);
  EXPECT_NE(read.error().message.find("lumigrid build"), std::string::npos);
}

TEST(Sha256, matchesThePublishedHashOfAbc) {
  const support::TemporaryDirectory directory;
  const std::string path = directory / "abc";
  std::ofstream(path) << "abc";
  auto hash = base::sha256OfFile(path);
  ASSERT_TRUE(hash);
  EXPECT_EQ(*hash, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");  // FIPS 180-2, appendix B.1
}

}  // namespace
