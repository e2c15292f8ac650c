// XYZ text gives the points, colours and normals of each form of its columns; bad lines are named by number.
#include <cmath>

#include "tests/mesh/mesh_files.h"

namespace {

using namespace mesh_files;

base::Result<Cloud> readXyz(const std::string& text, const std::string& name = "cloud.xyz") {
  return readCloud(text, name);
}

/// The cloud of a text that must be read; empty, and a failed test, where it is refused.
Cloud cloudOf(const std::string& text, const std::string& name = "cloud.xyz") {
  auto cloud = readXyz(text, name);
  EXPECT_TRUE(cloud) << cloud.error().message;
  return cloud ? std::move(*cloud) : Cloud();
}

void expectError(const std::string& text, const std::string& message, const std::string& name = "cloud.xyz") {
  const auto cloud = readXyz(text, name);
  ASSERT_FALSE(cloud) << "it was read; wanted: " << message;
  EXPECT_TRUE(contains(cloud.error().message, name + ": " + message)) << cloud.error().message;
  EXPECT_EQ(cloud.error().message.find('\n'), std::string::npos);
}

std::vector<glm::dvec3> points(std::initializer_list<glm::dvec3> list) {
  return list;
}

// ---- Forms of columns

TEST(XyzReader, threeColumnsArePositions) {
  const Cloud cloud = cloudOf("1 2 3\n-4.5 5e2 +6\n500000.123 4000000.25 0.001\n");
  EXPECT_EQ(cloud.positions, points({{1, 2, 3}, {-4.5, 500, 6}, {500000.123, 4000000.25, 0.001}}));
  EXPECT_TRUE(cloud.colors.empty());
  EXPECT_TRUE(cloud.normals.empty());
  EXPECT_EQ(cloud.file.vertices, 3U);
  EXPECT_FALSE(cloud.file.has_colors);
  EXPECT_TRUE(cloud.file.warnings.empty());
}

TEST(XyzReader, aFourthColumnIsAnIntensityThatIsNotUsed) {
  const Cloud cloud = cloudOf("1 2 3 0.5\n4 5 6 -2047\n");
  EXPECT_EQ(cloud.positions, points({{1, 2, 3}, {4, 5, 6}}));
  EXPECT_TRUE(cloud.colors.empty());
  ASSERT_EQ(cloud.file.warnings.size(), 1U);
  EXPECT_EQ(cloud.file.warnings[0], "its points are read without \"intensity\"");
}

TEST(XyzReader, sixColumnsHoldColorsOfEightBits) {
  const Cloud cloud = cloudOf("1 2 3 255 0 17\n4 5 6 1 0 0\n");
  ASSERT_EQ(cloud.colors.size(), 2U);
  EXPECT_EQ(cloud.colors[0], glm::u8vec4(255, 0, 17, 255));
  EXPECT_EQ(cloud.colors[1], glm::u8vec4(1, 0, 0, 255));
  EXPECT_TRUE(cloud.file.has_colors);
  EXPECT_TRUE(cloud.file.warnings.empty());
}

TEST(XyzReader, decimalsUpToOneAreColors) {
  const Cloud cloud = cloudOf("1 2 3 1 0 0.2\n4 5 6 0.5 0.5 1.0\n");
  ASSERT_EQ(cloud.colors.size(), 2U);
  EXPECT_EQ(cloud.colors[0], glm::u8vec4(255, 0, 51, 255));
  EXPECT_EQ(cloud.colors[1], glm::u8vec4(128, 128, 255, 255));
}

TEST(XyzReader, zerosAndOnesWithoutDecimalsAreNearlyBlack) {
  EXPECT_EQ(cloudOf("1 2 3 1 1 0\n4 5 6 0 1 1\n").colors.at(0), glm::u8vec4(1, 1, 0, 255));
}

TEST(XyzReader, oneLateColorAboveOneMakesAllOfThemGoTo255) {
  std::string text;
  for (int i = 0; i < 100000; ++i) text += std::to_string(i) + " 0 0 0.0 0.5 1.0\n";
  const Cloud cloud = cloudOf(text + "0 1 0 51.0 200.0 0.0\n");
  ASSERT_EQ(cloud.positions.size(), 100001U);
  ASSERT_EQ(cloud.colors.size(), 100001U);
  EXPECT_EQ(cloud.colors.front(), glm::u8vec4(0, 1, 1, 255));
  EXPECT_EQ(cloud.colors.back(), glm::u8vec4(51, 200, 0, 255));
  EXPECT_EQ(cloud.file.vertices, 100001U);
}

TEST(XyzReader, vectorsOfUnitLengthAreNormals) {
  const Cloud cloud = cloudOf("1 2 3 0 0 1\n4 5 6 -0.6 0.8 0\n7 8 9 0 0 0\n7 8 9 nan nan nan\n", "cloud.xyzn");
  ASSERT_EQ(cloud.normals.size(), 4U);
  EXPECT_EQ(cloud.normals[1], glm::vec3(-0.6F, 0.8F, 0.0F));
  EXPECT_TRUE(std::isnan(cloud.normals[3].x));
  EXPECT_TRUE(cloud.colors.empty());
  EXPECT_TRUE(cloud.file.has_normals);
}

TEST(XyzReader, blackAmongPureColorsIsNoNormal) {
  const Cloud cloud = cloudOf("1 2 3 1.0 0.0 0.0\n4 5 6 0.0 0.0 0.0\n");
  ASSERT_EQ(cloud.colors.size(), 2U);
  EXPECT_EQ(cloud.colors[0], glm::u8vec4(255, 0, 0, 255));
}

TEST(XyzReader, sevenColumnsAreThoseOfPts) {
  const Cloud cloud = cloudOf("2\n1 2 3 -1024 10 20 30\n4 5 6 7 40 50 60\n", "cloud.pts");
  EXPECT_EQ(cloud.positions, points({{1, 2, 3}, {4, 5, 6}}));
  ASSERT_EQ(cloud.colors.size(), 2U);
  EXPECT_EQ(cloud.colors[1], glm::u8vec4(40, 50, 60, 255));
  EXPECT_EQ(cloud.file.warnings.size(), 1U);
}

TEST(XyzReader, nineColumnsHoldColorsAndNormals) {
  const Cloud cloud = cloudOf("1 2 3 255 128 0 0 0 -1\n");
  ASSERT_EQ(cloud.colors.size(), 1U);
  ASSERT_EQ(cloud.normals.size(), 1U);
  EXPECT_EQ(cloud.colors[0], glm::u8vec4(255, 128, 0, 255));
  EXPECT_EQ(cloud.normals[0], glm::vec3(0, 0, -1));
}

// ---- Names, counts, comments, separators

TEST(XyzReader, namesTellTheColumnsInAnyOrder) {
  for (const std::string names :
       {"x y z nx ny nz red green blue label\n", "//X,Y,Z,Nx,Ny,Nz,R,G,B,Label\n", "# x y z nx ny nz r g b label\n",
        "\"X\";\"Y\";\"Z\";\"NX\";\"NY\";\"NZ\";\"R\";\"G\";\"B\";\"Label\"\n"}) {
    const Cloud cloud = cloudOf(names + "1 2 3 0 0 1 10 20 30 wall\n");
    ASSERT_EQ(cloud.colors.size(), 1U) << names;
    EXPECT_EQ(cloud.colors[0], glm::u8vec4(10, 20, 30, 255));
    ASSERT_EQ(cloud.normals.size(), 1U);
    EXPECT_EQ(cloud.normals[0], glm::vec3(0, 0, 1));
    ASSERT_EQ(cloud.file.warnings.size(), 1U);
  }
  const Cloud cloud = cloudOf("b,g,r,z,y,x\n1,2,3,4,5,6\n", "cloud.csv");
  EXPECT_EQ(cloud.positions, points({{6, 5, 4}}));
  EXPECT_EQ(cloud.colors.at(0), glm::u8vec4(3, 2, 1, 255));
}

TEST(XyzReader, columnsThatAreNotUsedAreCounted) {
  const Cloud cloud = cloudOf("x y z a c d e f r g\n1 2 3 4 5 6 7 8 9 10\n");
  ASSERT_EQ(cloud.file.warnings.size(), 1U);
  EXPECT_EQ(cloud.file.warnings[0], "its points are read without \"a\", \"c\", \"d\", \"e\" and 3 more columns");
  EXPECT_TRUE(cloud.colors.empty());
}

TEST(XyzReader, aCommentThatNamesOtherColumnsIsAComment) {
  EXPECT_EQ(cloudOf("# x y z of a church\n1 2 3\n").positions.size(), 1U);
  expectError("x y z intensity\n1 2 3\n", "line 1 names 4 columns, and line 2 has 3");
}

TEST(XyzReader, commentsAndBlankLinesArePassedOver) {
  const Cloud cloud = cloudOf("\xEF\xBB\xBF# made by hand\n\n  // two points\n1 2 3\n#4 5 6\n   \n//\n7 8 9\n# end");
  EXPECT_EQ(cloud.positions, points({{1, 2, 3}, {7, 8, 9}}));
}

TEST(XyzReader, anySeparatorsAndLineBreaksAreRead) {
  for (const std::string separator : {" ", "\t", ",", ";", ", ", " ; ", "   "})
    for (const std::string line_break : {"\n", "\r\n", " \r\n", "\n\n"}) {
      const std::string& s = separator;
      const Cloud cloud = cloudOf("1" + s + "2" + s + "3" + line_break + " 4" + s + "5" + s + "6" + line_break);
      EXPECT_EQ(cloud.positions, points({{1, 2, 3}, {4, 5, 6}})) << '"' << separator << '"';
    }
  EXPECT_EQ(cloudOf("1;2;3;\n4;5;6;\n").positions.size(), 2U);
  EXPECT_EQ(cloudOf("1 2 3\n4 5 6").positions.size(), 2U);
}

TEST(XyzReader, scansWithCountsFollowEachOther) {
  const Cloud cloud = cloudOf("2\r\n1 2 3\r\n4 5 6\r\n1\r\n7 8 9\r\n", "cloud.pts");
  EXPECT_EQ(cloud.positions, points({{1, 2, 3}, {4, 5, 6}, {7, 8, 9}}));
  EXPECT_TRUE(cloud.file.warnings.empty());
  EXPECT_EQ(cloudOf("1\n1 2 3\n4 5 6\n").file.warnings.at(0), "its count of points is 1, and it has 2; all are read");
}

TEST(XyzReader, allItsNamesAreTriedAndContentComesFirst) {
  for (const std::string name : {"xyz", "txt", "pts", "asc", "csv", "xyzrgb", "xyzn", "XYZ"})
    EXPECT_EQ(cloudOf("1 2 3\n", "cloud." + name).positions.size(), 1U) << name;
  const auto ply = readXyz(
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
      "property float z\nend_header\n1 2 3\n");
  EXPECT_TRUE(ply) << ply.error().message;
  EXPECT_EQ(cloudOf("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").file.triangles, 1U);
  EXPECT_EQ(cloudOf("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n").file.triangles, 1U);
}

TEST(XyzReader, blocksComeInTheFilesOrder) {
  std::string text;
  constexpr int kPoints = 200000;
  for (int i = 0; i < kPoints; ++i) text += std::to_string(i) + " 0.5 -1 " + std::to_string(i % 256) + " 0 0\n";
  const Cloud cloud = cloudOf(text);
  ASSERT_EQ(cloud.positions.size(), std::size_t{kPoints});
  ASSERT_EQ(cloud.colors.size(), std::size_t{kPoints});
  for (int i = 0; i < kPoints; ++i) {
    ASSERT_EQ(cloud.positions[static_cast<std::size_t>(i)].x, i);
    ASSERT_EQ(cloud.colors[static_cast<std::size_t>(i)].r, i % 256);
  }
}

// ---- Errors

TEST(XyzReader, badLinesAreNamedByNumber) {
  expectError("", "the file is empty");
  expectError("# nothing\n\n", "the file has no points");
  expectError("hello world\n", "line 1: \"hello\" is neither a number nor the first of the columns' names");
  expectError("# c\n1 2 3\n1 two 3\n", "line 3: \"two\" is not a number");
  expectError("1 2 3\n1 2 0x3\n", "line 2: \"0x3\" is not a number");
  expectError("1 2 3\n\n1 2\n4 5 6\n", "line 3: it has 2 columns, and line 1 has 3");
  expectError("#\n1 2 3\n1 2 3 4\n", "line 3: it has 4 columns, and line 2 has 3");
  expectError("1 2 3\n7\n1 2 3\n", "line 2: it has 1 column, and line 1 has 3");
  expectError("1 2\n", "line 1: columns without names are x y z, x y z intensity, x y z r g b, x y z nx ny nz, ");
  expectError("1 2 3 4 5\n", "line 1: columns without names are x y z");
  expectError("1 2 3\n1 nan 3\n", "line 2: a coordinate is not finite");
  expectError("1 2 3\n1 2 -inf\n", "line 2: a coordinate is not finite");
  expectError("1 2 3\n1 2 1e999\n", "line 2: \"1e999\" is not a number");
  expectError("1 2 3 0 0 0\n1 2 3 0 256 0\n", "line 2: a colour is not within 0 to 255");
  expectError("1 2 3 0 0 0\n1 2 3 0 -3 0\n", "line 2: a colour is not within 0 to 255");
  expectError("1 2 3 0 0 0\n1 2 3 0 0 nan\n", "line 2: a colour is not within 0 to 255");
  expectError("1,5;2,5;3,5\n", "line 1: its columns are separated in two ways");
  expectError("1,5 2,5 3,5\n", "line 1: its columns are separated in two ways");
}

TEST(XyzReader, cutFilesAreTruncated) {
  expectError("1 2 3\n4 5", "truncated: the file ends in line 2");
  expectError("3\n1 2 3\n4 5 6\n", "truncated: the file ends in point 2 of 3");
  expectError("3\n", "truncated: the file ends in point 0 of 3");
}

TEST(XyzReader, hugeLinesCostNothing) {
  const std::string word(1 << 20, '7');
  expectError(word, "line 1: \"777777");
  expectError("1 2 3\n" + word + "\n", "line 2: \"777777");
  expectError("1 2 3\n1 2 x" + word, "line 2: \"x777777");
  std::string columns;
  for (int i = 0; i < 100000; ++i) columns += "1 ";
  expectError(columns, "line 1: columns without names are");
  expectError("1 2 3\n" + columns + "\n", "line 2: it has more than 64 columns");
  EXPECT_EQ(cloudOf("#" + word + "\n1 2 3\n#" + columns + "\n").positions.size(), 1U);
  expectError(std::string(1000, '\0'), "line 1: \"????");
}

TEST(XyzReader, withoutSplatsACloudGetsTheAdviceOfAPly) {
  EXPECT_TRUE(contains(errorOf("a.xyz", "1 2 3\n"), "mesh it first, or build it with --methods qsplat or pmr"));
}

TEST(XyzReader, filesCutAtEveryLengthNeverCrash) {
  const std::string whole = "\xEF\xBB\xBF//X,Y,Z,R,G,B\n2\n1.5,2,3,0.1,0.2,1\n\n4,5e1,6,0.3,0,7\r\n# end\n";
  for (std::size_t length = 1; length <= whole.size(); ++length) {
    const auto cloud = readXyz(whole.substr(0, length));
    if (!cloud) {
      EXPECT_EQ(cloud.error().message.find('\n'), std::string::npos);
    }
  }
}

}  // namespace
