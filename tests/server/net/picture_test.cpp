// Tests how /render's parameters are parsed, without rendering.
#include "server/net/picture.h"

#include <gtest/gtest.h>

#include <cmath>

namespace server {
namespace {

constexpr std::uint64_t kMax = 64'000'000;
const std::string kView = "/render?position=1,2,3&direction=0,1,0&up=0,0,1";

base::Result<PictureRequest> parse(const std::string& target) {
  const auto query = parseQuery(target);
  if (!query) return query.error();
  return parsePictureRequest(*query, kMax);
}

TEST(PictureRequest, defaultsAreThoseOfTheDocument) {
  const auto request = parse(kView);
  ASSERT_TRUE(request) << request.error().message;
  EXPECT_EQ(request->camera.position, glm::dvec3(1.0, 2.0, 3.0));
  EXPECT_EQ(request->camera.direction, glm::dvec3(0.0, 1.0, 0.0));
  EXPECT_EQ(request->camera.width, 1280);
  EXPECT_EQ(request->camera.height, 720);
  EXPECT_DOUBLE_EQ(request->camera.fov_y, std::acos(-1.0) / 4.0);
  EXPECT_EQ(request->format, PictureRequest::Format::kPng);
  EXPECT_EQ(request->supersampling, 2);
  EXPECT_EQ(request->camera.ortho_height, 0.0);
  EXPECT_FALSE(request->background);
}

TEST(PictureRequest, everyValueIsRead) {
  const auto request = parse(
      "/render?position=500000.001,4000000.002,-3e1&target=500000.001,4000000.002,70&up=0,2,0&fov_y_degrees=90&"
      "ortho_height=12.5&width=8000&height=8000&format=jpeg&quality=75&supersampling=4&background=ff8000");
  ASSERT_TRUE(request) << request.error().message;
  EXPECT_EQ(request->camera.position.x, 500000.001);
  EXPECT_EQ(request->camera.direction, glm::dvec3(0.0, 0.0, 1.0));
  EXPECT_EQ(request->camera.ortho_height, 12.5);
  EXPECT_EQ(request->format, PictureRequest::Format::kJpeg);
  EXPECT_EQ(request->quality, 75);
  EXPECT_EQ(request->supersampling, 4);
  EXPECT_EQ(request->background, (Rgb{255, 128, 0}));
}

TEST(PictureRequest, angleMayBeInRadians) {
  EXPECT_DOUBLE_EQ(parse(kView + "&fov_y=1.25")->camera.fov_y, 1.25);
  for (const char* bad : {"&fov_y=0", "&fov_y=3.15", "&fov_y=nan", "&fov_y=1&fov_y_degrees=57"})
    EXPECT_FALSE(parse(kView + bad)) << bad;
}

TEST(PictureRequest, sectionIsAPlaneThatCutsOneSideAway) {
  const auto below = parse(kView + "&section=y,-120.5,b&colors=resolution&tolerance=4");
  ASSERT_TRUE(below) << below.error().message;
  EXPECT_EQ(below->camera.section, (base::SectionPlane{{0.0, 1.0, 0.0}, -120.5}));
  EXPECT_TRUE(below->resolution_colors);
  EXPECT_EQ(below->tolerance_px, 4.0F);
  EXPECT_EQ(parse(kView + "&section=z,4e6,a")->camera.section, (base::SectionPlane{{0.0, 0.0, -1.0}, -4e6}));
  EXPECT_FALSE(parse(kView)->camera.section);
}

TEST(PictureRequest, lightIsADirection) {
  const auto lit = parse(kView + "&light=0,3,4");
  ASSERT_TRUE(lit) << lit.error().message;
  ASSERT_TRUE(lit->light);
  EXPECT_LT(glm::length(*lit->light - glm::dvec3(0.0, 0.6, 0.8)), 1e-12);
  EXPECT_FALSE(parse(kView)->light);
}

TEST(PictureRequest, jpegHasAWhiteBackgroundByDefault) {
  EXPECT_EQ(parse(kView + "&format=jpeg")->background, (Rgb{255, 255, 255}));
  EXPECT_FALSE(parse(kView + "&format=jpeg&background=transparent"));
}

TEST(PictureRequest, aJpegHasTheScenesBackgroundUnlessItIsToldAnother) {
  const Rgb blue{1, 2, 255};
  const auto backgroundOf = [&](const std::string& more) {
    const auto query = parseQuery(kView + more);
    const auto request = parsePictureRequest(*query, kMax, blue);
    return request ? request->background : std::nullopt;
  };
  EXPECT_EQ(backgroundOf("&format=jpeg"), blue);
  EXPECT_EQ(backgroundOf("&format=jpeg&background=ff8000"), (Rgb{255, 128, 0}));
  EXPECT_FALSE(backgroundOf("")) << "alpha of a PNG says where the model is";
}

TEST(PictureRequest, errorsNameTheWrongValueInOneLine) {
  const std::string position = "/render?position=1,2,3";
  const std::pair<std::string, std::string> cases[] = {
      {"/render", "position"},
      {"/render?position=1,2&direction=0,1,0", "position"},
      {"/render?position=1,2,nan&direction=0,1,0", "position"},
      {"/render?position=1,2,3,4&direction=0,1,0", "position"},
      {"/render?position=1e13,0,0&direction=0,1,0", "position"},
      {position, "direction"},
      {position + "&direction=0,0,0", "direction"},
      {position + "&target=1,2,3", "direction"},
      {position + "&direction=0,1,0&target=0,0,0", "direction"},
      {position + "&direction=0,1,0&up=0,5,0", "parallel"},
      {position + "&direction=0,1,0&up=0,0,0", "up"},
      {kView + "&width=0", "width"},
      {kView + "&width=-5", "width"},
      {kView + "&height=1.5", "height"},
      {kView + "&height=99999999999999999999", "height"},
      {kView + "&width=8001&height=8000", "at most 64000000"},
      {kView + "&fov_y_degrees=0", "fov_y_degrees"},
      {kView + "&fov_y_degrees=180", "fov_y_degrees"},
      {kView + "&fov_y_degrees=inf", "fov_y_degrees"},
      {kView + "&ortho_height=-1", "ortho_height"},
      {kView + "&format=gif", "format"},
      {kView + "&quality=0", "quality"},
      {kView + "&supersampling=5", "supersampling"},
      {kView + "&background=blue", "background"},
      {kView + "&background=12345", "background"},
      {kView + "&light=0,0,0", "light"},
      {kView + "&light=1,2", "light"},
      {kView + "&section=", "section"},
      {kView + "&section=x", "section"},
      {kView + "&section=w,1,a", "section"},
      {kView + "&section=x,1", "section"},
      {kView + "&section=x,,b", "section"},
      {kView + "&section=x,1e13,b", "section"},
      {kView + "&section=x,1,c", "section"},
      {kView + "&colors=rainbow", "colors"},
      {kView + "&tolerance=0.1", "tolerance"},
      {kView + "&tolerance=1001", "tolerance"},
      {kView + "&colour=1", "none of"},
  };
  for (const auto& [target, piece] : cases) {
    const auto request = parse(target);
    ASSERT_FALSE(request) << target;
    EXPECT_NE(request.error().message.find(piece), std::string::npos) << target << ": " << request.error().message;
    EXPECT_EQ(request.error().message.find('\n'), std::string::npos);
  }
}

}  // namespace
}  // namespace server
