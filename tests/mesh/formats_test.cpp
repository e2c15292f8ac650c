// Each format is written out by hand, and the unit square comes in as it is drawn here. OpenMesh reads the same files
// as an independent second way.
//
//   3 --- 2
//   |   / |
//   | /   |
//   0 --- 1
#include "tests/mesh/mesh_files.h"
#include "tests/support/open_mesh.h"

namespace {

using namespace mesh_files;

const std::string kAsciiSquare =
    "ply\nformat ascii 1.0\ncomment square\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";

/// Returns a binary square with every property kind we know, and some we don't.
std::string binarySquare(bool big) {
  std::string b = "ply\nformat ";
  b += big ? "binary_big_endian" : "binary_little_endian";
  b += " 1.0\nobj_info x\nelement camera 2\nproperty double fov\nproperty list uchar short tags\n"
       "element vertex 4\nproperty double x\nproperty double y\nproperty double z\nproperty float confidence\n"
       "property float nx\nproperty float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\nproperty "
       "uchar blue\n"
       "property uchar alpha\nelement face 2\nproperty uchar flags\nproperty list uchar uint vertex_index\n"
       "property list uchar float texcoord\nend_header\n";
  for (int camera = 0; camera < 2; ++camera) {
    put(b, 0.5, big);
    put(b, std::uint8_t{2});
    put(b, std::int16_t{7}, big);
    put(b, std::int16_t{8}, big);
  }
  const double xy[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  for (int v = 0; v < 4; ++v) {
    for (const double x : {xy[v][0], xy[v][1], 0.0}) put(b, x, big);
    for (const float x : {0.5F, 0.0F, 0.0F, 2.0F}) put(b, x, big);
    for (const int c : {10 * v, 200, 255, 128}) put(b, static_cast<std::uint8_t>(c));
  }
  for (const auto& t : {std::array<std::uint32_t, 3>{0, 1, 2}, std::array<std::uint32_t, 3>{0, 2, 3}}) {
    put(b, std::uint8_t{1});
    put(b, std::uint8_t{3});
    for (const std::uint32_t i : t) put(b, i, big);
    put(b, std::uint8_t{2});
    put(b, 0.25F, big);
    put(b, 0.75F, big);
  }
  return b;
}

TEST(PlyReader, asciiPolygonsBecomeFans) {
  expectSquare(read("square.ply", kAsciiSquare));
}

TEST(PlyReader, windowsLineEndsAreRead) {
  std::string windows;
  for (const char c : kAsciiSquare) windows += c == '\n' ? std::string("\r\n") : std::string(1, c);
  expectSquare(read("square.ply", windows));
}

TEST(PlyReader, contentDecidesOverTheName) {
  expectSquare(read("square.stl", kAsciiSquare));
}

TEST(PlyReader, bothByteOrdersGiveTheSameMeshAndSkipUnknownProperties) {
  for (const bool big : {false, true}) {
    auto result = read("square.ply", binarySquare(big));
    expectSquare(result);
    ASSERT_TRUE(result);
    EXPECT_TRUE(result->file.has_normals);
    ASSERT_EQ(result->mesh.colors.size(), 4U);
    for (int v = 0; v < 4; ++v) EXPECT_EQ(result->mesh.colors[v], glm::u8vec4(10 * v, 200, 255, 255)) << big;
  }
}

TEST(PlyReader, floatAndDiffuseColorsAreRead) {
  auto result = read("c.ply",
                     "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
                     "property float diffuse_red\nproperty float diffuse_green\nproperty float diffuse_blue\n"
                     "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
                     "0 0 0 1 0.5 0\n1 0 0 0 0 0\n0 1 0 2 -1 nan\n3 0 1 2\n");
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_EQ(result->mesh.colors[0], glm::u8vec4(255, 128, 0, 255));
  EXPECT_EQ(result->mesh.colors[2], glm::u8vec4(255, 0, 0, 255));
}

TEST(PlyReader, triangleStripsTurnEveryOtherTriangle) {
  // The strip 0-1-3-2 has the triangles (0 1 3) and (1 2 3); a restart and a single triangle the other way follow.
  auto result = read("strip.ply",
                     "ply\nformat ascii 1.0\nelement vertex 5\nproperty int x\nproperty int y\nproperty int z\n"
                     "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
                     "0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0 0\n8 0 1 3 2 -1 1 4 2\n");
  ASSERT_TRUE(result) << result.error().message;
  const std::vector<std::uint32_t> triangles{0, 1, 3, 1, 2, 3, 1, 4, 2};
  EXPECT_EQ(result->mesh.indices, triangles);
}

TEST(PlyReader, texturesGiveOneWarningLine) {
  std::string textured = kAsciiSquare;
  textured.replace(textured.find("comment square"), 14, "comment TextureFile a.png");
  auto result = read("square.ply", textured);
  expectSquare(result);
  ASSERT_EQ(result->file.warnings.size(), 1U);
  EXPECT_NE(result->file.warnings[0].find("textures are not used"), std::string::npos);
}

TEST(ObjReader, polygonsNegativeIndicesAndContinuedLinesAreRead) {
  expectSquare(read("square.obj", "# square\no thing\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"));
  expectSquare(read("square.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf -4 -3 \\\n -2 -1"));
  const auto unnamed = read("square.obj", "mtllib \nusemtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n");
  expectSquare(unnamed);
  EXPECT_TRUE(unnamed->file.warnings.empty());
}

TEST(ObjReader, cornersMayLeaveOutANumberButNotItsSlash) {
  expectSquare(read("square.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nf 1// 2/1/ 3/ 4\n"));
}

TEST(ObjReader, colorsAndNormalsGoToTheirVertices) {
  auto result = read("c.obj",
                     "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nvn 0 0 2\nvn 0 3 0\nvt 0 0\nmtllib a.mtl\nusemtl b\n"
                     "f 1/1/1 2//1 3/1/2\n");
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_EQ(result->mesh.colors[1], glm::u8vec4(0, 255, 0, 255));
  EXPECT_EQ(result->mesh.normals[0], glm::vec3(0.0F, 0.0F, 1.0F));
  EXPECT_EQ(result->mesh.normals[2], glm::vec3(0.0F, 1.0F, 0.0F));
  ASSERT_EQ(result->file.warnings.size(), 1U);
  EXPECT_NE(result->file.warnings[0].find("its materials cannot be read, vertex colours stay"), std::string::npos);
}

TEST(ObjReader, colorsUpTo255AreRecognized) {
  auto result = read("c.obj", "v 0 0 0 255 0 51\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 2 3\n");
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_EQ(result->mesh.colors[0], glm::u8vec4(255, 0, 51, 255));
  EXPECT_EQ(result->mesh.colors[1], glm::u8vec4(0, 1, 0, 255));
}

const float kTwoTriangles[2][3][3] = {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}}, {{0, 0, 0}, {1, 1, 0}, {0, 1, 0}}};

std::string binaryStl(const std::string& header) {
  std::string b = header;
  b.resize(80, ' ');
  put(b, std::uint32_t{2});
  for (const auto& triangle : kTwoTriangles) {
    for (int k = 0; k < 3; ++k) put(b, 0.0F);
    for (const auto& corner : triangle)
      for (const float x : corner) put(b, x);
    put(b, std::uint16_t{0});
  }
  return b;
}

TEST(StlReader, textAndBinaryGiveTheSameSquare) {
  std::string text = "solid square\n";
  for (const auto& triangle : kTwoTriangles) {
    text += " facet normal 0 0 1\n  outer loop\n";
    for (const auto& c : triangle)
      text += "   vertex " + std::to_string(c[0]) + " " + std::to_string(c[1]) + " " + std::to_string(c[2]) + "\n";
    text += "  endloop\n endfacet\n";
  }
  auto from_text = read("square.stl", text + "endsolid square\n");
  expectSquare(from_text);
  EXPECT_EQ(from_text->file.vertices, 6U);
  expectSquare(read("square.stl", binaryStl("made by a scanner")));
}

TEST(StlReader, binaryFilesThatBeginWithSolidAreKnownByTheirSize) {
  expectSquare(read("square.stl", binaryStl("solid but binary")));
}

TEST(OffReader, plainColoredAndNormalFormsAreRead) {
  expectSquare(read("square.off", "OFF\n# comment\n4 1 0\n\n0 0 0\n1 0 0 # corner\n1 1 0\n0 1 0\n4 0 1 2 3 255 0 0\n"));
  auto coloured =
      read("square.off",
           "COFF 4 1 0\n0 0 0 255 0 0 255\n1 0 0 0 255 0 255\n1 1 0 0 0 255 255\n0 1 0 9 9 9 255\n4 0 1 2 3\n");
  expectSquare(coloured);
  EXPECT_EQ(coloured->mesh.colors[2], glm::u8vec4(0, 0, 255, 255));
  auto both = read(
      "square.off",
      "CNOFF\n4 1 0\n0 0 0 0 0 5 .5 0 0\n1 0 0 0 0 5 1 0 0 1\n1 1 0 0 0 5 0 1 0 1\n0 1 0 0 0 5 0 0 1\n4 0 1 2 3\n");
  expectSquare(both);
  EXPECT_TRUE(both->file.has_normals);
  EXPECT_EQ(both->mesh.colors[0], glm::u8vec4(128, 0, 0, 255));
}

TEST(OffReader, aFaceMayGoOverSeveralLines) {
  expectSquare(read("square.off", "OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 # corners\n1 2\n\n3 255 0 0\n"));
}

TEST(AllReaders, textsOfVerticesAloneAreCloudsWhereTheseAreAccepted) {
  const std::pair<std::string, std::string> clouds[] = {
      {"a.obj", "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\n"}, {"a.off", "COFF\n2 0 0\n0 0 0 255 0 0 255\n1 0 0 0 255 0 255\n"}};
  for (const auto& [name, bytes] : clouds) {
    EXPECT_NE(errorOf(name, bytes).find(mesh::kOnlyPoints), std::string::npos);
    const auto cloud = readCloud(bytes, name);
    ASSERT_TRUE(cloud) << cloud.error().message;
    EXPECT_EQ(cloud->positions.size(), 2U) << name;
    EXPECT_EQ(cloud->colors[1], glm::u8vec4(0, 255, 0, 255)) << name;
  }
}

// Cameras of depth write a point of NaN for each pixel that saw nothing.
TEST(PlyReader, pointsWithoutAPlaceAreLeftOutOfCloudsAndCounted) {
  const std::string header =
      "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
  const auto cloud = readCloud(header + "nan nan nan 0 0 0\n1 2 3 9 0 0\n4 inf 6 0 9 0\n7 8 9 0 0 9\n", "a.ply");
  ASSERT_TRUE(cloud) << cloud.error().message;
  EXPECT_EQ(cloud->positions, (std::vector<glm::dvec3>{{1, 2, 3}, {7, 8, 9}}));
  EXPECT_EQ(cloud->colors[1], glm::u8vec4(0, 0, 9, 255));
  ASSERT_EQ(cloud->file.warnings.size(), 1U);
  EXPECT_NE(cloud->file.warnings[0].find("2 of its points are left out"), std::string::npos);

  const std::string row = "nan 0 0 0 0 0\n";
  const auto none = readCloud(header + row + row + row + row, "a.ply");
  ASSERT_FALSE(none);
  EXPECT_NE(none.error().message.find("a.ply: none of its points has a finite place"), std::string::npos);
}

// ---- OpenMesh ----

// OpenMesh reads each of its formats as we do: as many triangles, in the same box, of the same area.
TEST(AllReaders, openMeshReadsTheSameMesh) {
  const std::vector<std::pair<std::string, std::string>> files{
      {"square.ply", kAsciiSquare},
      {"square.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1 4//1\n"},
      {"square.off", "OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n"},
      {"square.stl", binaryStl("made by a scanner")}};
  for (const auto& [name, bytes] : files) {
    const std::string path = write(name, bytes);
    const auto ours = support::readMesh(path);
    const auto theirs = support::readByOpenMesh(path);
    ASSERT_TRUE(ours) << ours.error().message;
    ASSERT_TRUE(theirs) << name;
    EXPECT_EQ(ours->mesh.triangleCount(), theirs->triangleCount()) << name;
    EXPECT_EQ(ours->mesh.box().min, theirs->box().min) << name;
    EXPECT_EQ(ours->mesh.box().max, theirs->box().max) << name;
    EXPECT_NEAR(support::areaOf(ours->mesh), support::areaOf(*theirs), 1e-6) << name;
    std::remove(path.c_str());
  }
}

// ---- Numbers ----

TEST(ObjReader, decimalsBecomeTheNearestFloats) {
  auto result = read("t.obj", "v 0.1 -0.2 0.3\nv 1 0 0.7\nv 0.123456789 1 0\nf 1 2 3\n");
  ASSERT_TRUE(result);
  EXPECT_EQ(result->mesh.positions[0], glm::vec3(0.1F, -0.2F, 0.3F));
  EXPECT_EQ(result->mesh.positions[2].x, 0.123456789F);
}

}  // namespace
