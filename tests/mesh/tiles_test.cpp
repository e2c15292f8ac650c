// 3D Tiles: the finest tiles of local tilesets come in as one mesh. The content of all tiles is the unit square; in a
// tile it stands upright, since glTF's y becomes z.
#include <cmath>
#include <filesystem>
#include <glm/gtc/matrix_transform.hpp>

#include "base/png/png.h"
#include "mesh/texture.h"
#include "tests/mesh/gltf_files.h"

namespace {

using namespace mesh_files;

std::string squareGlb() {
  std::string binary;
  const json document = squareDocument(binary);
  return glb(document, binary);
}

/// A batched model; its header has 28 bytes, and its tables end at multiples of 8.
std::string b3dm(std::string feature_table, const std::string& feature_binary, const std::string& glb_bytes) {
  feature_table.resize((28 + feature_table.size() + 7) / 8 * 8 - 28, ' ');
  const std::string batch_table = R"({"name":["a"]}  )";
  std::string b = "b3dm";
  const std::size_t tables = feature_table.size() + feature_binary.size() + batch_table.size();
  put(b, std::uint32_t{1});
  for (const std::size_t n : {28 + tables + glb_bytes.size(), feature_table.size(), feature_binary.size(),
                              batch_table.size(), std::size_t{0}})
    put(b, static_cast<std::uint32_t>(n));
  return b + feature_table + feature_binary + batch_table + glb_bytes;
}

json moved(double x, double y, double z) {
  return {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, y, z, 1};
}

const json kBox = {{"box", {0, 0, 0, 10, 0, 0, 0, 10, 0, 0, 0, 10}}};

json tile(const std::string& uri, json children = json::array()) {
  json t = {{"boundingVolume", kBox}, {"geometricError", 1}};
  if (!uri.empty()) t["content"] = {{"uri", uri}};
  if (!children.empty()) t["children"] = std::move(children);
  return t;
}

json tileset(json root, const std::string& refine = "REPLACE") {
  if (!refine.empty()) root["refine"] = refine;
  return {{"asset", {{"version", "1.0"}}}, {"geometricError", 8}, {"root", std::move(root)}};
}

class Tiles : public testing::Test {
 protected:
  struct Read {
    support::WholeMesh mesh;
    mesh::StreamedFile file;
  };
  std::string add(const std::string& name, const std::string& bytes) const {
    const std::string path = folder / name;
    std::filesystem::create_directories(std::filesystem::path(path).parent_path());
    std::ofstream(path, std::ios::binary) << bytes;
    return path;
  }
  std::string addJson(const std::string& name, const json& text) const { return add(name, text.dump()); }
  static base::Result<Read> readFile(const std::string& path) {
    Read read;
    LUMIGRID_ASSIGN_OR_RETURN(read.file, mesh::streamMesh(path, read.mesh, {}));
    return read;
  }
  base::Result<Read> readTileset(const json& set) const { return readFile(addJson("tileset.json", set)); }
  std::string refusal(const json& set) const {
    const auto read = readTileset(set);
    EXPECT_FALSE(read);
    return read ? "" : read.error().message;
  }
  /// Where the squares' first corners lie, in their order.
  static std::vector<glm::dvec3> squares(const base::Result<Read>& read) {
    std::vector<glm::dvec3> first;
    EXPECT_TRUE(read) << read.error().message;
    if (read)
      for (std::size_t v = 0; v < read->mesh.positions.size(); v += 4) first.push_back(read->mesh.positions[v]);
    return first;
  }
  /// A tile whose square is moved to x.
  json tileAt(double x, json children = json::array()) const {
    const std::string name = "t" + std::to_string(std::lround(x)) + ".b3dm";
    add(name, b3dm("{\"BATCH_LENGTH\":0,\"RTC_CENTER\":[" + std::to_string(x) + ",0,0]}", "", squareGlb()));
    return tile(name, std::move(children));
  }

  const support::TemporaryDirectory folder;
};

using Places = std::vector<glm::dvec3>;

TEST_F(Tiles, contentsAreTurnedFromYUpToZUp) {
  add("a.glb", squareGlb());
  const auto read = readTileset(tileset(tile("a.glb")));
  ASSERT_TRUE(read) << read.error().message;
  const Places upright{{0, 0, 0}, {1, 0, 0}, {1, 0, 1}, {0, 0, 1}};
  EXPECT_EQ(read->mesh.positions, upright);
  EXPECT_EQ(read->file.triangles, 2U);
  EXPECT_EQ(read->file.georeference.units, "m");
  EXPECT_EQ(read->file.georeference.up, mesh::Georeference::Up::kZ);
  EXPECT_TRUE(read->file.warnings.empty());

  // Older tilesets say which axis points up.
  json set = tileset(tile("a.glb"));
  set["asset"]["gltfUpAxis"] = "Z";
  const Places flat{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  EXPECT_EQ(readTileset(set)->mesh.positions, flat);
  set["asset"]["gltfUpAxis"] = "X";
  const Places from_x{{0, 0, 0}, {0, 0, 1}, {0, 1, 1}, {0, 1, 0}};
  EXPECT_EQ(readTileset(set)->mesh.positions, from_x);
}

TEST_F(Tiles, theFinestReplaceTheCoarser) {
  // The coarse tiles are not even there.
  const json set = tileset(tile("none.b3dm", {tileAt(1), tile("nowhere.b3dm", {tileAt(2), tileAt(3)})}));
  EXPECT_EQ(squares(readTileset(set)), (Places{{1, 0, 0}, {2, 0, 0}, {3, 0, 0}}));
  // Children without content replace nothing.
  EXPECT_EQ(squares(readTileset(tileset(tileAt(4, {tile(""), tile("", {tile("")})})))), (Places{{4, 0, 0}}));
}

TEST_F(Tiles, allAreReadWhereTheyAddToEachOther) {
  json root = tileAt(1, {tileAt(2), tileAt(3, {tileAt(4)})});
  EXPECT_EQ(squares(readTileset(tileset(root, "ADD"))), (Places{{2, 0, 0}, {4, 0, 0}, {3, 0, 0}, {1, 0, 0}}));
  // A tile below may refine otherwise, and those below it as it does.
  root["children"][1]["refine"] = "REPLACE";
  EXPECT_EQ(squares(readTileset(tileset(root, "ADD"))), (Places{{2, 0, 0}, {4, 0, 0}, {1, 0, 0}}));
  // In the beginning the names had small letters.
  EXPECT_EQ(squares(readTileset(tileset(tileAt(1, {tileAt(2)}), "add"))).size(), 2U);
}

TEST_F(Tiles, transformsAreMultipliedDownTheTree) {
  json child = tileAt(1);
  child["transform"] = {2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 5, 1};
  json root = tile("", {child});
  root["transform"] = moved(100, 200, 0);
  const auto read = readTileset(tileset(root));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->mesh.positions[0], glm::dvec3(102, 200, 5));
  EXPECT_EQ(read->mesh.positions[2], glm::dvec3(104, 200, 7));
  root["transform"] = {1, 2, 3};
  EXPECT_NE(refusal(tileset(root)).find("the transform of a tile is not 16 numbers"), std::string::npos);
}

TEST_F(Tiles, millimetresStayAtGeocentricCoordinates) {
  // East, north and up at 45° N, 10° E, as columns; and the surface of the ellipsoid there.
  const double lat = 0.25 * std::acos(-1.0), lon = std::acos(-1.0) / 18.0;
  const glm::dvec3 east(-std::sin(lon), std::cos(lon), 0.0);
  const glm::dvec3 up(std::cos(lat) * std::cos(lon), std::cos(lat) * std::sin(lon), std::sin(lat));
  const glm::dvec3 north = glm::cross(up, east);
  const glm::dvec3 center(4449130.123456, 784502.654321, 4487348.408866);
  json root = tile("");
  root["transform"] = json::array();
  for (const auto& [axis, w] : {std::pair{east, 0}, {north, 0}, {up, 0}, {center, 1}}) {
    for (int k = 0; k < 3; ++k) root["transform"].push_back(axis[k]);
    root["transform"].push_back(w);
  }
  json child = tileAt(0);
  child["transform"] = moved(0.001, 0.002, 0.003);
  root["children"] = {child};
  root["boundingVolume"] = {{"region", {lon, lat, lon + 1e-4, lat + 1e-4, 0, 20}}};
  const auto read = readTileset(tileset(root));
  ASSERT_TRUE(read) << read.error().message;
  for (const auto& [v, local] : {std::pair{0, glm::dvec3(0.001, 0.002, 0.003)}, {2, glm::dvec3(1.001, 0.002, 1.003)}}) {
    const glm::dvec3 wanted = center + local.x * east + local.y * north + local.z * up;
    EXPECT_LT(glm::distance(read->mesh.positions[static_cast<std::size_t>(v)], wanted), 1e-8);
  }
  EXPECT_EQ(read->file.georeference.crs, "EPSG:4978");
  EXPECT_EQ(read->file.georeference.up, mesh::Georeference::Up::kUnknown);

  // A box tells it, too, since its middle lies as far from the earth's as the surface.
  root["boundingVolume"] = kBox;
  EXPECT_EQ(readTileset(tileset(root))->file.georeference.crs, "EPSG:4978");
  // Northings of a map are as long.
  root["transform"] = moved(500000, 6350000, 10);
  EXPECT_EQ(readTileset(tileset(root))->file.georeference.crs, "");
}

TEST_F(Tiles, modelsHaveTheirCentreInTheTableOrInAnExtension) {
  std::string center;
  for (const float x : {0.0F, 7.0F, 8.0F, 9.0F}) put(center, x);
  add("binary.b3dm", b3dm(R"({"BATCH_LENGTH":0,"RTC_CENTER":{"byteOffset":4}})", center, squareGlb()));
  EXPECT_EQ(squares(readTileset(tileset(tile("binary.b3dm")))), (Places{{7, 8, 9}}));
  EXPECT_EQ(squares(readFile(folder / "binary.b3dm")), (Places{{7, 8, 9}}));
  std::string binary;
  json document = squareDocument(binary);
  document["extensions"]["CESIUM_RTC"]["center"] = {1, 2, 3};
  add("extension.glb", glb(document, binary));
  EXPECT_EQ(squares(readTileset(tileset(tile("extension.glb")))), (Places{{1, 2, 3}}));
  add("plain.b3dm", b3dm("", "", squareGlb()));
  EXPECT_EQ(squares(readTileset(tileset(tile("plain.b3dm")))), (Places{{0, 0, 0}}));
  add("bad.b3dm", b3dm(R"({"RTC_CENTER":{"byteOffset":8}})", center, squareGlb()));
  EXPECT_NE(refusal(tileset(tile("bad.b3dm"))).find("RTC_CENTER reaches past its feature table"), std::string::npos);
}

TEST_F(Tiles, tilesetsMayNameOthers) {
  // The inner one lies in its own folder, beside its tiles, and replaces the outer tile.
  add("inner/fine tile.b3dm", b3dm("{}", "", squareGlb()));
  json inner = tile("fine%20tile.b3dm?v=1.0");
  inner["transform"] = moved(0, 0, 3);
  addJson("inner/tileset.json", tileset(inner, ""));
  json outer = tile("inner/tileset.json");
  outer["transform"] = moved(0, 2, 0);
  json root = tile("nowhere.b3dm", {outer});
  root["transform"] = moved(1, 0, 0);
  EXPECT_EQ(squares(readTileset(tileset(root))), (Places{{1, 2, 3}}));
}

TEST_F(Tiles, severalContentsAndOlderNamesAreRead) {
  (void)tileAt(1), (void)tileAt(2), (void)tileAt(3);
  json root = tile("");
  root["contents"] = {{{"uri", "t1.b3dm"}}, {{"uri", "t2.b3dm"}}};
  EXPECT_EQ(squares(readTileset(tileset(root))).size(), 2U);
  root.erase("contents");
  root["extensions"]["3DTILES_multiple_contents"]["content"] = {{{"uri", "t1.b3dm"}}, {{"uri", "t3.b3dm"}}};
  EXPECT_EQ(squares(readTileset(tileset(root))).size(), 2U);
  root = tile("");
  root["content"]["url"] = "t3.b3dm";
  EXPECT_EQ(squares(readTileset(tileset(root))), (Places{{3, 0, 0}}));
  std::string binary;
  json document = squareDocument(binary);
  document["buffers"][0]["uri"] = "data:;base64," + base64(binary);
  addJson("a.gltf", document);
  EXPECT_EQ(squares(readTileset(tileset(tile("a.gltf")))).size(), 1U);
}

TEST_F(Tiles, contentsThatAreNotReadAreCounted) {
  add("a.pnts", std::string("pnts") + std::string(24, '\0'));
  add("a.i3dm", std::string("i3dm") + std::string(28, '\0'));
  add("a.cmpt", std::string("cmpt") + std::string(12, '\0'));
  json root = tile("", {tile("a.pnts"), tile("a.pnts"), tile("a.i3dm"), tile("a.cmpt"),
                        tile("https://example.org/a.b3dm"), tileAt(1)});
  const std::string kinds =
      "1 at other hosts, 1 of instanced models (i3dm), 2 of points (pnts), 1 of several formats in one (cmpt)";
  const auto read = readTileset(tileset(root));
  EXPECT_EQ(squares(read).size(), 1U);
  ASSERT_EQ(read->file.warnings.size(), 1U);
  EXPECT_EQ(read->file.warnings[0], "it is read without tiles that are not read: " + kinds);
  // A coarser tile stays where those that would replace it are not read.
  json coarse = tileAt(2);
  coarse["children"] = {tile("a.pnts")};
  EXPECT_EQ(squares(readTileset(tileset(coarse))), (Places{{2, 0, 0}}));
  root["children"].erase(5);
  EXPECT_NE(refusal(tileset(root)).find("the file has no faces (a point cloud?)"), std::string::npos);
  root["children"].erase(1), root["children"].erase(0);
  const std::string others = "1 at other hosts, 1 of instanced models (i3dm), 1 of several formats in one (cmpt)";
  EXPECT_NE(refusal(tileset(root)).find("none of its tiles can be read; there are " + others), std::string::npos);
  EXPECT_NE(refusal(tileset(tile(""))).find("the tileset has no content"), std::string::npos);
}

TEST_F(Tiles, missingAndBrokenTilesAreNamed) {
  json root = tile("", {tileAt(1), tile("gone.b3dm")});
  EXPECT_NE(refusal(tileset(root)).find(folder / "gone.b3dm"), std::string::npos) << refusal(tileset(root));
  add("gone.b3dm", "");
  EXPECT_NE(refusal(tileset(root)).find("gone.b3dm: its content is of no kind that 3D Tiles know (it is empty)"),
            std::string::npos);
  add("gone.b3dm", "\x1F\x8B with gzip");
  EXPECT_NE(refusal(tileset(root)).find("gone.b3dm: it is compressed by gzip"), std::string::npos);
  add("gone.b3dm", "{\"root\":");
  EXPECT_NE(refusal(tileset(root)).find("gone.b3dm: the JSON is broken"), std::string::npos);
  const std::string whole = b3dm(R"({"RTC_CENTER":[1,2,3]})", "", squareGlb());
  for (std::size_t length = 4; length < whole.size(); ++length) {
    add("gone.b3dm", whole.substr(0, length));
    const std::string message = refusal(tileset(root));
    EXPECT_NE(message.find("gone.b3dm: "), std::string::npos) << message;
  }
}

TEST_F(Tiles, tilesetsThatNameThemselvesAreErrors) {
  EXPECT_NE(refusal(tileset(tile("tileset.json"))).find("a tileset names itself"), std::string::npos);
  addJson("a/other.json", tileset(tile("../a/../tileset.json")));
  EXPECT_NE(refusal(tileset(tile("a/other.json"))).find("a tileset names itself"), std::string::npos);
  // One that is named twice is read twice.
  json twice = tile("", {tile("one.json"), tile("one.json")});
  twice["children"][1]["transform"] = moved(0, 9, 0);
  addJson("one.json", tileset(tileAt(5)));
  EXPECT_EQ(squares(readTileset(tileset(twice))), (Places{{5, 0, 0}, {5, 9, 0}}));
}

TEST_F(Tiles, treesOfAnyDepthAreErrorsWhereTheyAreTooDeep) {
  json deep = tileAt(1);
  for (int i = 0; i < 400; ++i) deep = tile("", {std::move(deep)});
  EXPECT_EQ(squares(readTileset(tileset(deep))).size(), 1U);
  for (int i = 0; i < 200; ++i) deep = tile("", {std::move(deep)});
  EXPECT_NE(refusal(tileset(deep)).find("its tiles are nested more than 512 deep"), std::string::npos);
}

TEST_F(Tiles, picturesWithinModelsAreFound) {
  base::Image image(2, 2, 3);
  std::fill(image.pixels.begin(), image.pixels.end(), std::uint8_t{90});
  ASSERT_TRUE(base::writePng(image, folder / "picture.png"));
  std::ifstream file(folder / "picture.png", std::ios::binary);
  const std::string png(std::istreambuf_iterator<char>(file), {});
  std::string binary;
  json d = squareDocument(binary);
  const std::size_t at = binary.size();
  for (int i = 0; i < 8; ++i) put(binary, 0.5F);
  binary += png;
  d["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", at}, {"byteLength", 32}});
  d["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", at + 32}, {"byteLength", png.size()}});
  d["accessors"].push_back({{"bufferView", 3}, {"componentType", 5126}, {"count", 4}, {"type", "VEC2"}});
  d["images"] = {{{"bufferView", 4}, {"mimeType", "image/png"}}};
  d["textures"] = {{{"source", 0}}};
  d["materials"] = {{{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}};
  d["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = 3;
  d["meshes"][0]["primitives"][0]["material"] = 0;
  const std::string path = add("inner/textured.b3dm", b3dm(R"({"BATCH_LENGTH":0})", "", glb(d, binary)));
  const auto read = readTileset(tileset(tile("inner/textured.b3dm")));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_TRUE(read->file.warnings.empty());
  ASSERT_EQ(read->file.pictures.size(), 1U);
  EXPECT_EQ(read->file.pictures[0].path, path);
  const auto decoded = mesh::readPicture(read->file.pictures[0]);
  ASSERT_TRUE(decoded) << decoded.error().message;
  EXPECT_EQ(decoded->pixels, image.pixels);
}

TEST_F(Tiles, progressGoesOverTheTilesAndCanCancel) {
  const std::string path = addJson("tileset.json", tileset(tile("", {tileAt(1), tileAt(2), tileAt(3), tileAt(4)})));
  support::WholeMesh whole;
  mesh::StreamOptions options;
  std::vector<double> shares;
  options.progress = [&](double share) {
    shares.push_back(share);
    return true;
  };
  ASSERT_TRUE(mesh::streamMesh(path, whole, options));
  EXPECT_EQ(shares, (std::vector<double>{0.25, 0.5, 0.75, 1.0}));
  options.progress = [](double share) { return share < 0.5; };
  const auto cancelled = mesh::streamMesh(path, whole, options);
  ASSERT_FALSE(cancelled);
  EXPECT_EQ(cancelled.error().code, base::ErrorCode::kCancelled);
}

}  // namespace
