// A LAS file becomes a scene of splats that knows where on earth it lies; points as text become that of their PLY.
#include <algorithm>
#include <cmath>
#include <glm/glm.hpp>
#include <glm/gtx/string_cast.hpp>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "tests/programs/run_program.h"
#include "tests/support/las_file.h"

namespace {

using programs::readText;
using programs::run;
using support::LasFile;

class CloudTest : public programs::ProgramTest {
 protected:
  /// A cube's surface of points, 10 m wide, far from the origin: no side is shorter, so that its shape tells no up.
  std::string cloud(const std::string& name, const std::string& epsg, const std::string& unit) {
    LasFile file;
    file.offset = {500000.0, 4000000.0, 100.0};
    constexpr int kSide = 20, kStep = 500;
    for (int i = 0; i < kSide; ++i)
      for (int j = 0; j < kSide; ++j)
        for (int side = 0; side < 6; ++side) {
          support::LasPoint point;
          const auto axis = static_cast<std::size_t>(side % 3);
          point.number[axis] = side < 3 ? 0 : kSide * kStep;
          point.number[(axis + 1) % 3] = i * kStep;
          point.number[(axis + 2) % 3] = j * kStep;
          point.color = {static_cast<std::uint16_t>(12 * i), static_cast<std::uint16_t>(12 * j), 90};
          file.points.push_back(point);
        }
    file.records.emplace_back(
        2112, "PROJCS[\"grid\",GEOGCS[\"base\"],UNIT[\"unit\"," + unit + "],AUTHORITY[\"EPSG\",\"" + epsg + "\"]]");
    programs::writeText(path(name), bytesOf(file));
    return path(name);
  }
  /// The same points and colours as text, and as PLY without faces: their paths.
  std::pair<std::string, std::string> textAndPly() {
    std::string lines;
    constexpr int kSide = 40;
    for (int i = 0; i < kSide; ++i)
      for (int j = 0; j < kSide; ++j)
        lines += std::to_string(i) + " " + std::to_string(j) + " " + std::to_string(std::sin(0.2 * i)) + " " +
                 std::to_string(6 * i) + " " + std::to_string(6 * j) + " 90\n";
    programs::writeText(path("cloud.xyz"), "// a wavy sheet\n" + lines);
    programs::writeText(path("cloud.ply"),
                        "ply\nformat ascii 1.0\nelement vertex " + std::to_string(kSide * kSide) +
                            "\nproperty double x\nproperty double y\nproperty double z\nproperty uchar red\n"
                            "property uchar green\nproperty uchar blue\nend_header\n" +
                            lines);
    return {path("cloud.xyz"), path("cloud.ply")};
  }
  /// A strip of points that lies at a slant in its box, and its path.
  std::pair<std::vector<glm::dvec3>, std::string> slantedStrip() {
    std::vector<glm::dvec3> points;
    std::string lines;
    for (int i = 0; i < 200; ++i)
      for (int j = 0; j < 20; ++j) {
        points.emplace_back(500000.0 + i - j, 4000000.0 + i + j, 0.5 * std::sin(0.3 * i));
        for (int k = 0; k < 3; ++k) lines += std::to_string(points.back()[k]) + (k < 2 ? " " : "\n");
      }
    programs::writeText(path("strip.xyz"), lines);
    return {points, path("strip.xyz")};
  }
  /// How far scene.json's hull goes along a direction, from the first point.
  double hullEnd(const glm::dvec3& direction, const glm::dvec3& first) const {
    const nlohmann::json hull = scene()["hull"];
    double end = -1e9;
    for (const auto& p : hull) end = std::max(end, glm::dot(glm::dvec3(p[0], p[1], p[2]) - first, direction));
    return end;
  }
  nlohmann::json scene() const { return nlohmann::json::parse(readText(path("scene/scene.json"))); }
};

TEST_F(CloudTest, aLasFileBecomesAGeoreferencedSceneOfSplats) {
  const auto built =
      run("lumigrid", {"build", cloud("a.las", "32612", "1"), "-o", path("scene"), "--methods", "qsplat", "--quiet"});
  ASSERT_EQ(built.status, 0) << built.err;
  EXPECT_EQ(built.err, "");
  EXPECT_EQ(scene()["crs"], "EPSG:32612");
  EXPECT_EQ(scene()["units"], "m");
  EXPECT_EQ(scene()["up"], nlohmann::json({0.0, 0.0, 1.0}));
  EXPECT_EQ(scene()["box_min"], nlohmann::json({500000.0, 4000000.0, 100.0}));
  EXPECT_EQ(scene()["box_max"], nlohmann::json({500010.0, 4000010.0, 110.0}));
  EXPECT_EQ(scene()["has_colors"], true);
}

TEST_F(CloudTest, theUsersUnitsAndUpComeFirst) {
  const auto built = run("lumigrid", {"build", cloud("a.las", "2992", "0.3048"), "-o", path("scene"), "--methods",
                                      "qsplat", "--units", "yard", "--up", "y", "--quiet"});
  ASSERT_EQ(built.status, 0) << built.err;
  EXPECT_NE(built.err.find("its coordinates are in feet"), std::string::npos);
  EXPECT_EQ(scene()["units"], "yard");
  EXPECT_EQ(scene()["up"], nlohmann::json({0.0, 1.0, 0.0}));
}

TEST_F(CloudTest, pointsAsTextMakeTheSplatsOfTheirPly) {
  const auto [text, ply] = textAndPly();
  std::string files[2];
  for (const std::string& source : {text, ply}) {
    const std::string scene = source + ".scene";
    const auto built = run("lumigrid", {"build", source, "-o", scene, "--methods", "qsplat", "--json"});
    ASSERT_EQ(built.status, 0) << built.err;
    EXPECT_EQ(nlohmann::json::parse(built.out)["qsplat"]["leaves"], 1600) << built.out;
    files[source == ply ? 1 : 0] = readText(scene + "/qsplat.lgq");
  }
  EXPECT_TRUE(files[0] == files[1]) << files[0].size() << " and " << files[1].size() << " bytes";
}

// Whoever brings a scan need not know which methods points can have.
TEST_F(CloudTest, withoutAWordOfMethodsPointsBecomeSplats) {
  const std::string points = textAndPly().first;
  const auto built = run("lumigrid", {"build", points, "-o", path("scene")});
  ASSERT_EQ(built.status, 0) << built.err;
  EXPECT_NE(built.err.find("points without faces, so only qsplat is built"), std::string::npos) << built.err;
  EXPECT_EQ(scene()["parameters"]["methods"], "qsplat");
  const auto missing = run("lumigrid", {"build", points, "-o", path("scene"), "--missing"});
  EXPECT_EQ(missing.status, 0) << missing.out << missing.err;

  // The same command again finds all there, and without MESH it knows the methods.
  const std::string first = readText(path("scene/qsplat.lgq"));
  for (const auto& command : {std::vector<std::string>{"build", points, "-o", path("scene"), "--quiet"},
                              std::vector<std::string>{"build", "-o", path("scene"), "--quiet"}}) {
    const auto again = run("lumigrid", command);
    EXPECT_EQ(again.status, 0) << again.err;
    EXPECT_EQ(readText(path("scene/qsplat.lgq")), first);
  }
  EXPECT_EQ(run("lumigrid", {"verify", path("scene"), "--quiet"}).status, 0);

  // Who asks for patches is told that there can be none.
  programs::expectOneLineError(run("lumigrid", {"build", points, "-o", path("no"), "--methods", "patch", "--quiet"}), 1,
                               {"cloud.xyz", "no faces", "--methods qsplat"});
}

TEST_F(CloudTest, aHullHoldsThePointsCloserThanTheirBox) {
  const auto [points, text] = slantedStrip();
  const auto built = run("lumigrid", {"build", text, "-o", path("scene"), "--methods", "qsplat", "--quiet"});
  ASSERT_EQ(built.status, 0) << built.err;
  ASSERT_TRUE(scene().contains("hull"));
  EXPECT_FALSE(scene().contains("start_direction")) << "points do not tell it";
  const glm::dvec3 along = glm::normalize(glm::dvec3(1, 1, 0)), across = glm::normalize(glm::dvec3(-1, 1, 0));
  for (const glm::dvec3& direction : {along, -along, across, -across, glm::dvec3(0, 0, 1), glm::dvec3(1, 0, 0)}) {
    double end = -1e9;
    for (const glm::dvec3& p : points) end = std::max(end, glm::dot(p - points[0], direction));
    EXPECT_GT(hullEnd(direction, points[0]), end - 0.01) << glm::to_string(direction);
    // Splats reach beyond their points.
    EXPECT_LT(hullEnd(direction, points[0]), end + 6.0) << glm::to_string(direction);
  }
  const auto first = scene()["hull"];
  const auto set = run("lumigrid", {"set", path("scene"), "--up", "y"});
  ASSERT_EQ(set.status, 0) << set.err;
  EXPECT_EQ(scene()["hull"], first) << "it has no up";
}

TEST_F(CloudTest, aStrayAboveASurveyMakesItNoTower) {
  std::string lines;
  for (int i = 0; i < 100; ++i)
    for (int j = 0; j < 100; ++j)
      lines += std::to_string(i) + " " + std::to_string(j) + " " + std::to_string(3.0 * std::sin(0.1 * i)) + "\n";
  programs::writeText(path("survey.xyz"), lines + "40 50 5000\n");
  const auto built =
      run("lumigrid", {"build", path("survey.xyz"), "-o", path("scene"), "--methods", "qsplat", "--quiet"});
  ASSERT_EQ(built.status, 0) << built.err;
  EXPECT_EQ(scene()["box_max"][2], 5000.0);
  EXPECT_LT(hullEnd(glm::dvec3(0, 0, 1), glm::dvec3(0.0)), 30.0);
  EXPECT_EQ(scene()["up"], nlohmann::json({0.0, 0.0, 1.0}));
}

TEST_F(CloudTest, aBadLineOfTextIsNamed) {
  programs::writeText(path("a.xyz"), "1 2 3\n4 5 six\n");
  const auto built = run("lumigrid", {"build", path("a.xyz"), "-o", path("scene"), "--methods", "qsplat", "--quiet"});
  programs::expectOneLineError(built, 1, {"a.xyz: line 2: \"six\" is not a number"});
}

TEST_F(CloudTest, filesInDifferentSystemsGiveAWarningAndNone) {
  const auto built = run("lumigrid", {"build", cloud("a.las", "32612", "1"), cloud("b.las", "32613", "1"), "-o",
                                      path("scene"), "--methods", "qsplat", "--quiet"});
  ASSERT_EQ(built.status, 0) << built.err;
  EXPECT_NE(built.err.find("(EPSG:32612 and EPSG:32613)"), std::string::npos) << built.err;
  EXPECT_FALSE(scene().contains("crs"));
  EXPECT_EQ(scene()["units"], "m");
}

// A warning must not be lost with a build that fails hours later.
TEST_F(CloudTest, aWarningIsPrintedBeforeALaterMethodFails) {
  const auto built = run("lumigrid", {"build", cloud("a.las", "32612", "1"), cloud("b.las", "32613", "1"), "-o",
                                      path("scene"), "--methods", "qsplat,hlod", "--quiet"});
  EXPECT_NE(built.status, 0);
  const std::size_t warned = built.err.find("warning: the files are in different");
  const std::size_t failed = built.err.find("no faces");
  ASSERT_NE(warned, std::string::npos) << built.err;
  ASSERT_NE(failed, std::string::npos) << built.err;
  EXPECT_LT(warned, failed);
}

}  // namespace
