// PTX: scans come to stand where their scanners did, and what says nothing is left out.
#include "tests/mesh/mesh_files.h"

namespace {

using namespace mesh_files;

// A scan of 2 x 2 directions, turned by 90 degrees about z and moved.
std::string scan(const std::string& points, const std::string& counts = "2\n2\n") {
  return counts + "9 9 9\n1 0 0\n0 1 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n500000 4000000 100 1\n" + points;
}

TEST(PtxReader, scansStandWhereTheirMatricesSay) {
  const auto cloud = readCloud(scan("1 0 0 0.5 255 0 9\r\n0 2 0 0.5 0 255 9\n0 0 0 0.5 0 0 0\n0 0 3 0.5 0 0 9\n") +
                                   scan("1 0 0 0.25 7 8 9\n\n", "1\n1\n"),
                               "a.ptx");
  ASSERT_TRUE(cloud) << cloud.error().message;
  EXPECT_EQ(cloud->positions,
            (std::vector<glm::dvec3>{
                {500000, 4000001, 100}, {499998, 4000000, 100}, {500000, 4000000, 103}, {500000, 4000001, 100}}));
  ASSERT_EQ(cloud->colors.size(), 4U);
  EXPECT_EQ(cloud->colors[0], glm::u8vec4(255, 0, 9, 255));
  EXPECT_EQ(cloud->colors[3], glm::u8vec4(7, 8, 9, 255));
  ASSERT_EQ(cloud->file.warnings.size(), 1U);
  EXPECT_NE(cloud->file.warnings[0].find("1 of its points are left out"), std::string::npos);
}

TEST(PtxReader, intensitiesBecomeGreysUnlessAllAreTheSame) {
  const auto grey = readCloud(scan("1 0 0 0\n0 2 0 0.5\n0 0 3 1\n1 1 1 1\n"), "a.ptx");
  ASSERT_TRUE(grey) << grey.error().message;
  ASSERT_EQ(grey->colors.size(), 4U);
  EXPECT_EQ(grey->colors[0], glm::u8vec4(0, 0, 0, 255));
  EXPECT_EQ(grey->colors[1], glm::u8vec4(188, 188, 188, 255)) << "half of the light, in sRGB";
  EXPECT_EQ(grey->colors[2], glm::u8vec4(255));
  ASSERT_EQ(grey->file.warnings.size(), 1U);
  EXPECT_NE(grey->file.warnings[0].find("it has no colours"), std::string::npos);
  const auto plain = readCloud(scan("1 0 0 0.5\n0 2 0 0.5\n0 0 3 0.5\n1 1 1 0.5\n"), "a.ptx");
  ASSERT_TRUE(plain) << plain.error().message;
  EXPECT_TRUE(plain->colors.empty());
}

TEST(PtxReader, badFilesAreNamedInOneLine) {
  const auto errorOfCloud = [](const std::string& bytes) {
    const auto cloud = readCloud(bytes, "a.ptx");
    EXPECT_FALSE(cloud);
    return cloud ? std::string() : cloud.error().message;
  };
  const std::pair<std::string, std::string> cases[] = {
      {"4\n", "truncated: the file ends in a scan's header"},
      {"4 4\n", "line 1: \"4\" is not the number of columns"},
      {"-1\n4\n", "line 1: \"-1\" is not the number of columns"},
      {"2000000000\n2000000000\n" + scan("", "").substr(0),
       "truncated: the file ends in point 0 of 4000000000000000000"},
      {scan("1 0 0 0.5\n"), "truncated: the file ends in point 0 of 4 of a scan"},
      {scan("1 0 0\n1 0 0 0.5\n1 0 0 0.5\n1 0 0 0.5\n"), "line 11: a point is x y z intensity"},
      {scan("1 0 q 1\n1 0 0 0.5\n1 0 0 0.5\n1 0 0 0.5\n"), "line 11: \"q\" is not a number"},
      {"1\n1\n0 0 0\n1 0 0\n0 1\n", "line 5: 3 numbers are needed"},
      {scan("0 0 0 0.5\n0 0 0 0.5\n0 0 0 0.5\n0 0 0 0.5\n"), "the file has no points"},
  };
  for (const auto& [bytes, message] : cases) {
    const std::string error = errorOfCloud(bytes);
    EXPECT_NE(error.find("a.ptx: " + message), std::string::npos) << error;
    EXPECT_EQ(error.find('\n'), std::string::npos);
  }
  EXPECT_NE(errorOf("a.ptx", scan("1 0 0 1\n1 0 0 1\n1 0 0 1\n1 0 0 1\n")).find(mesh::kOnlyPoints), std::string::npos);
}

}  // namespace
