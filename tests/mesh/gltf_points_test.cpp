// Points in glTF and in tiles of 3D Tiles: read where there are no triangles and the caller takes points.
#include <filesystem>

#include "tests/mesh/gltf_files.h"

namespace {

using namespace mesh_files;

using Places = std::vector<glm::dvec3>;
using Colors = std::vector<glm::u8vec4>;

/// A point tile: its feature table's JSON and its binary part.
std::string pnts(json table, const std::string& binary) {
  const std::string text = table.dump();
  std::string file = "pnts";
  put(file, std::uint32_t{1});
  for (const std::size_t n :
       {28 + text.size() + binary.size(), text.size(), binary.size(), std::size_t{0}, std::size_t{0}})
    put(file, static_cast<std::uint32_t>(n));
  return file + text + binary;
}

/// Three points, (1, 2, 3), (4, 5, 6) and (7, 8, 9), as floats.
std::string threePoints() {
  std::string binary;
  for (int i = 1; i <= 9; ++i) put(binary, static_cast<float>(i));
  return binary;
}

json pointsAt(int offset) {
  return {{"POINTS_LENGTH", 3}, {"POSITION", {{"byteOffset", offset}}}};
}

/// The square's four vertices as points, chosen by its six indices if `indexed`.
json pointDocument(std::string& binary, bool indexed) {
  json document = squareDocument(binary);
  json& primitive = document["meshes"][0]["primitives"][0];
  primitive["mode"] = 0;
  primitive["attributes"]["COLOR_0"] = 2;
  if (!indexed) primitive.erase("indices");
  return document;
}

class PointFiles : public testing::Test {
 protected:
  struct Read {
    support::WholeMesh mesh;
    mesh::StreamedFile file;
  };
  std::string add(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
    return folder_ / name;
  }
  base::Result<Read> read(const std::string& name, const std::string& bytes, bool accepts_points = true) const {
    Read read;
    mesh::StreamOptions options;
    options.accepts_points = accepts_points;
    LUMIGRID_ASSIGN_OR_RETURN(read.file, mesh::streamMesh(add(name, bytes), read.mesh, options));
    return read;
  }
  base::Result<Read> readTileset(const json& root) const {
    return read("tileset.json", json{{"asset", {{"version", "1.0"}}}, {"root", root}}.dump());
  }
  std::string refusal(const std::string& name, const std::string& bytes, bool accepts_points = true) const {
    const auto refused = read(name, bytes, accepts_points);
    EXPECT_FALSE(refused);
    return refused ? "" : refused.error().message;
  }
  static json tile(const std::string& uri) {
    return {{"boundingVolume", {{"sphere", {0, 0, 0, 9}}}}, {"refine", "REPLACE"}, {"content", {{"uri", uri}}}};
  }

  const support::TemporaryDirectory folder_;
};

TEST_F(PointFiles, ofGltfHaveColorsAndTheirNodesPlaces) {
  std::string binary;
  json document = pointDocument(binary, false);
  document["nodes"][0]["translation"] = {10, 0, 0};
  const auto cloud = read("a.glb", glb(document, binary));
  ASSERT_TRUE(cloud) << cloud.error().message;
  EXPECT_EQ(cloud->mesh.positions, (Places{{10, 0, 0}, {11, 0, 0}, {11, 1, 0}, {10, 1, 0}}));
  ASSERT_EQ(cloud->mesh.colors.size(), 4U);
  EXPECT_EQ(cloud->mesh.colors[3].r, 255);
  EXPECT_EQ(cloud->mesh.colors[3].g, 0);
  EXPECT_EQ(cloud->file.triangles, 0U);
  EXPECT_TRUE(cloud->file.warnings.empty());
  EXPECT_EQ(refusal("a.glb", glb(document, binary), false).substr((folder_ / "a.glb").size()),
            ": the file has no faces (a point cloud?); mesh it first, or build it with --methods qsplat or pmr");
}

TEST_F(PointFiles, ofGltfAreChosenByIndices) {
  std::string binary;
  const json document = pointDocument(binary, true);
  const auto cloud = read("a.glb", glb(document, binary));
  ASSERT_TRUE(cloud) << cloud.error().message;
  EXPECT_EQ(cloud->mesh.positions, (Places{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 0, 0}, {1, 1, 0}, {0, 1, 0}}));
  binary[64] = 9;  // the first index
  EXPECT_NE(refusal("a.glb", glb(document, binary)).find("index 9 is out of range (4 vertices)"), std::string::npos);
}

TEST_F(PointFiles, areLeftOutBesideTriangles) {
  std::string binary;
  json document = squareDocument(binary);
  document["meshes"][0]["primitives"].push_back({{"mode", 0}, {"attributes", {{"POSITION", 0}}}});
  const auto both = read("a.glb", glb(document, binary));
  ASSERT_TRUE(both) << both.error().message;
  EXPECT_EQ(both->file.triangles, 2U);
  EXPECT_EQ(both->mesh.positions.size(), 4U);
  ASSERT_EQ(both->file.warnings.size(), 1U);
  EXPECT_EQ(both->file.warnings[0], "1 primitives of points or lines are left out");
  // Lines alone are neither.
  document["meshes"][0]["primitives"] = {{{"mode", 1}, {"attributes", {{"POSITION", 0}}}}};
  EXPECT_NE(refusal("a.glb", glb(document, binary)).find("the file has no triangles"), std::string::npos);
}

TEST_F(PointFiles, ofTilesHaveEveryKindOfPositionAndColor) {
  json table = pointsAt(0);
  table["RTC_CENTER"] = {100, 0, 0};
  table["RGB"] = {{"byteOffset", 36}};
  const Colors colors{{1, 2, 3, 255}, {4, 5, 6, 255}, {7, 8, 9, 255}};
  const auto plain = read("a.pnts", pnts(table, threePoints() + "\1\2\3\4\5\6\7\10\11"));
  ASSERT_TRUE(plain) << plain.error().message;
  EXPECT_EQ(plain->mesh.positions, (Places{{101, 2, 3}, {104, 5, 6}, {107, 8, 9}}));
  EXPECT_EQ(plain->mesh.colors, colors);

  // RGBA goes before RGB, and alpha is not shown.
  table["RGBA"] = {{"byteOffset", 0}};
  std::string rgba;
  for (const glm::u8vec4& c : colors)
    for (const std::uint8_t value : {c.r, c.g, c.b, std::uint8_t{0}}) put(rgba, value);
  table["POSITION"]["byteOffset"] = 12;
  EXPECT_EQ(read("a.pnts", pnts(table, rgba + threePoints()))->mesh.colors, colors);

  json quantized = {{"POINTS_LENGTH", 2},
                    {"POSITION_QUANTIZED", {{"byteOffset", 0}}},
                    {"QUANTIZED_VOLUME_OFFSET", {10, 20, 30}},
                    {"QUANTIZED_VOLUME_SCALE", {1, 2, 65.535}},
                    {"RGB565", {{"byteOffset", 12}}},
                    {"NORMAL_OCT16P", {{"byteOffset", 16}}}};
  std::string binary;
  for (const std::uint16_t q : {0, 65535, 1000, 65535, 0, 0}) put(binary, q);
  for (const std::uint16_t c : {0xF800, 0x07FF}) put(binary, c);   // red; green and blue
  for (const std::uint8_t n : {255, 128, 128, 0}) put(binary, n);  // towards x and −y
  const auto small = read("a.pnts", pnts(quantized, binary));
  ASSERT_TRUE(small) << small.error().message;
  EXPECT_EQ(small->mesh.positions, (Places{{10, 22, 31}, {11, 20, 30}}));
  EXPECT_EQ(small->mesh.colors, (Colors{{255, 0, 0, 255}, {0, 255, 255, 255}}));
  ASSERT_EQ(small->mesh.normals.size(), 2U);
  EXPECT_GT(glm::normalize(small->mesh.normals[0]).x, 0.99F);
  EXPECT_LT(glm::normalize(small->mesh.normals[1]).y, -0.99F);

  table = pointsAt(0);
  table["CONSTANT_RGBA"] = {9, 8, 7, 100};
  EXPECT_EQ(read("a.pnts", pnts(table, threePoints()))->mesh.colors, Colors(3, {9, 8, 7, 255}));
}

TEST_F(PointFiles, ofATilesetStandUprightAndReplaceOneAnother) {
  add("coarse.pnts", pnts(pointsAt(0), threePoints()));
  add("fine.pnts", pnts(pointsAt(0), threePoints()));
  std::string binary;
  const json points = pointDocument(binary, false);
  add("fine.glb", glb(points, binary));
  json root = tile("coarse.pnts");
  root["children"] = {tile("fine.pnts"), tile("fine.glb")};
  root["children"][0]["transform"] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 50, 0, 0, 1};
  const auto cloud = readTileset(root);
  ASSERT_TRUE(cloud) << cloud.error().message;
  // Tiles of points have z up, and glTF's y is turned to it.
  EXPECT_EQ(cloud->mesh.positions,
            (Places{{51, 2, 3}, {54, 5, 6}, {57, 8, 9}, {0, 0, 0}, {1, 0, 0}, {1, 0, 1}, {0, 0, 1}}));
  EXPECT_EQ(cloud->file.georeference.units, "m");
  EXPECT_TRUE(cloud->file.warnings.empty());

  // Beside triangles points are left out, as ever.
  binary.clear();
  const json square = squareDocument(binary);
  add("fine.glb", glb(square, binary));
  const auto mesh = readTileset(root);
  ASSERT_TRUE(mesh) << mesh.error().message;
  EXPECT_EQ(mesh->file.triangles, 2U);
  ASSERT_EQ(mesh->file.warnings.size(), 1U);
  EXPECT_EQ(mesh->file.warnings[0], "it is read without tiles that are not read: 1 of points (pnts)");
}

TEST_F(PointFiles, ofBrokenTilesAreOneClearLine) {
  json table = pointsAt(0);
  const std::string whole = pnts(table, threePoints());
  for (std::size_t length = 4; length < whole.size(); ++length) {
    const std::string message = refusal("a.pnts", whole.substr(0, length));
    EXPECT_NE(message.find("truncated"), std::string::npos) << message;
  }
  table["POINTS_LENGTH"] = 4;
  EXPECT_NE(refusal("a.pnts", pnts(table, threePoints())).find("POSITION reaches past its feature table"),
            std::string::npos);
  for (const json& count : {json(1e18), json(std::uint64_t{1} << 62), json(-1), json("3"), json()}) {
    table["POINTS_LENGTH"] = count;
    EXPECT_NE(refusal("a.pnts", pnts(table, threePoints())).find("POINTS_LENGTH is missing, or more than the tile"),
              std::string::npos)
        << count;
  }
  EXPECT_NE(refusal("a.pnts", pnts({{"POINTS_LENGTH", 1}}, threePoints())).find("neither POSITION nor"),
            std::string::npos);
  table = {{"POINTS_LENGTH", 0}, {"POSITION", {{"byteOffset", 0}}}};
  EXPECT_NE(refusal("a.pnts", pnts(table, "")).find("the file has no points"), std::string::npos);
  table["extensions"]["3DTILES_draco_point_compression"] = json::object();
  EXPECT_NE(refusal("a.pnts", pnts(table, "")).find("compressed by Draco"), std::string::npos);
}

}  // namespace
