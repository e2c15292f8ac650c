#include "base/json/camera_file.h"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/temporary_directory.h"

namespace {

std::string write(const std::string& text) {
  static const support::TemporaryDirectory directory;
  std::string path = directory / "camera.json";
  std::ofstream(path) << text;
  return path;
}

TEST(CameraFile, targetBecomesAUnitDirection) {
  auto camera = base::readCamera(
      write(R"({"position":[0,0,5],"target":[0,0,1],"up":[0,1,0],"fov_y_degrees":60,"width":64,"height":32})"));
  ASSERT_TRUE(camera) << camera.error().message;
  EXPECT_EQ(camera->direction, glm::dvec3(0, 0, -1));
  EXPECT_NEAR(camera->fov_y, 1.0471975512, 1e-9);
  EXPECT_EQ(camera->width, 64);
}

TEST(CameraFile, badCamerasAreNamed) {
  const std::pair<const char*, const char*> cases[] = {
      {"{", "not valid JSON"},
      {"[]", "not a camera"},
      {R"({"position":[0,0]})", "position must be"},
      {R"({"position":[0,0,0]})", "direction or target"},
      {R"({"position":[0,0,0],"direction":[0,0,0]})", "direction is zero"},
      {R"({"position":[0,0,0],"direction":[0,1,0],"up":[0,2,0]})", "parallel"},
      {R"({"position":[0,0,0],"direction":[0,0,1],"width":0})", "width must be"},
      {R"({"position":[0,0,0],"direction":[0,0,1],"fov_y_degrees":180})", "fov_y_degrees"},
      {R"({"position":[0,0,0],"direction":[0,0,1],"ortho_height":-1})", "ortho_height"},
      {R"({"position":[0,0,0],"direction":[0,0,1],"ortho_height":"2"})", "ortho_height"},
      {R"({"position":[0,0,0],"direction":[0,0,1],"section":"z,2,b"})", "section must have"},
      {R"({"position":[0,0,0],"direction":[0,0,1],"section":{"normal":[0,0,0],"offset":1}})", "section must have"},
      {R"({"position":[0,0,0],"direction":[0,0,1],"section":{"normal":[0,0,1]}})", "section must have"},
      {R"({"position":[0,0,0],"direction":[0,0,1],"section":{"normal":[0,0,1],"offset":1e13}})", "offset of section"},
  };
  for (const auto& [text, what] : cases) {
    auto camera = base::readCamera(write(text));
    ASSERT_FALSE(camera) << text;
    EXPECT_NE(camera.error().message.find(what), std::string::npos) << camera.error().message;
  }
}

TEST(CameraPath, survivesWritingAndReading) {
  const auto path = base::orbitPath({0, 0, 0}, {2, 2, 2}, {0, 0, 1}, 12, 1.0, 0.5, 1.2, 320, 200);
  auto read = base::readCameraPath(write(base::formatCameraPath({path})));
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->frames.size(), path.size());
  EXPECT_EQ(read->frames_per_second, 0.0);
  for (std::size_t i = 0; i < path.size(); ++i) {
    EXPECT_LT(glm::length(read->frames[i].position - path[i].position), 1e-12);
    EXPECT_EQ(read->frames[i].width, 320);
  }
}

TEST(CameraPath, keepsItsTimes) {
  const base::CameraPath path{base::orbitPath({0, 0, 0}, {2, 2, 2}, {0, 0, 1}, 3, 1.0, 0.5, 1.2, 320, 200), 0.5, true};
  const auto read = base::readCameraPath(write(base::formatCameraPath(path)));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->frames_per_second, 0.5);
  EXPECT_TRUE(read->jumps);
  EXPECT_EQ(read->seconds(), 6.0);
  const std::string frames = R"("frames":[{"position":[0,0,5],"direction":[0,0,-1]}]})";
  for (const char* wrong : {R"({"frames_per_second":0,)", R"({"frames_per_second":"60",)", R"({"jumps":1,)"}) {
    const auto refused = base::readCameraPath(write(wrong + frames));
    ASSERT_FALSE(refused) << wrong;
    EXPECT_NE(refused.error().message.find("must be"), std::string::npos) << refused.error().message;
  }
}

TEST(CameraPath, orthographicFramesStayOrthographic) {
  auto path = base::orbitPath({0, 0, 0}, {2, 2, 2}, {0, 0, 1}, 2, 1.0, 0.5, 1.2, 320, 200);
  path[1].ortho_height = 3.5;
  auto read = base::readCameraPath(write(base::formatCameraPath({path})));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_FALSE(read->frames[0].orthographic());
  EXPECT_EQ(read->frames[1].ortho_height, 3.5);
}

TEST(CameraPath, framesKeepTheirSections) {
  auto path = base::orbitPath({0, 0, 0}, {2, 2, 2}, {0, 0, 1}, 2, 1.0, 0.5, 1.2, 320, 200);
  path[1].section = base::SectionPlane{{0.0, 0.6, -0.8}, 2.5};
  auto read = base::readCameraPath(write(base::formatCameraPath({path})));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_FALSE(read->frames[0].section.has_value());
  EXPECT_EQ(read->frames[1].section, path[1].section);
  const auto longer = base::readCamera(
      write(R"({"position":[0,0,0],"direction":[0,0,1],"up":[0,1,0],"section":{"normal":[0,0,4],"offset":6}})"));
  ASSERT_TRUE(longer) << longer.error().message;
  EXPECT_EQ(longer->section, (base::SectionPlane{{0.0, 0.0, 1.0}, 1.5})) << "a normal of any length";
}

TEST(CameraPath, orbitKeepsItsDistanceAndLooksAtTheCentre) {
  for (const auto& c : base::orbitPath({-1, -1, 0}, {3, 1, 2}, {0, 1, 0}, 16, 1.0, 0.3, 1.5, 100, 100)) {
    const glm::dvec3 to_center = glm::dvec3(1, 0, 1) - c.position;
    EXPECT_NEAR(glm::length(to_center), 1.5 * glm::length(glm::dvec3(4, 2, 2)), 1e-9);
    EXPECT_LT(glm::length(glm::normalize(to_center) - c.direction), 1e-12);
  }
}

TEST(CameraPath, badFrameIsNamedByNumber) {
  auto read =
      base::readCameraPath(write(R"({"frames":[{"position":[0,0,5],"direction":[0,0,-1]},{"position":[0,0,5]}]})"));
  ASSERT_FALSE(read);
  EXPECT_NE(read.error().message.find("frame 1"), std::string::npos) << read.error().message;
}

}  // namespace
