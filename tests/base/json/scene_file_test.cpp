#include "base/json/scene_file.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>

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
  scene.parts.push_back({"patch.lgp", 77, "cd"});
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
