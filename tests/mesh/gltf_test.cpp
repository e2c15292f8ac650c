// glTF 2.0 as one GLB and as JSON with other files. All squares are that of formats_test.cpp.
#include <cmath>

#include "base/png/png.h"
#include "mesh/texture.h"
#include "tests/mesh/gltf_files.h"

namespace {

using namespace mesh_files;

// ---- Documents of one file ----

TEST(GlbReader, stridesIndicesAndByteColorsAreRead) {
  std::string binary;
  json document = squareDocument(binary);
  document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 2;
  auto result = read("square.glb", glb(document, binary));
  expectSquare(result);

  // Linear 55/255 is sRGB 128: glTF's colours are linear.
  EXPECT_EQ(result->mesh.colors[0], glm::u8vec4(255, 0, 128, 255));
}

TEST(GlbReader, nodesMoveTurnScaleAndMirrorTheirMeshes) {
  std::string binary;
  json document = squareDocument(binary);
  // The parent lies at survey coordinates; its child is turned 90° about z (x to y) and mirrored in z.
  const double h = std::sqrt(0.5);
  document["nodes"] = {{{"translation", {431000.25, 5410000.5, 0}}, {"children", {1}}},
                       {{"mesh", 0}, {"rotation", {0, 0, h, h}}, {"scale", {2, 2, -1}}}};
  auto result = read("square.glb", glb(document, binary));
  ASSERT_TRUE(result) << result.error().message;
  const auto world = [&](std::size_t v) { return result->mesh.origin + glm::dvec3(result->mesh.positions[v]); };
  EXPECT_LT(glm::distance(world(1), glm::dvec3(431000.25, 5410002.5, 0.0)), 1e-5);
  EXPECT_LT(glm::distance(world(2), glm::dvec3(430998.25, 5410002.5, 0.0)), 1e-5);

  // Mirrored, the square faces the other way: its winding has to be turned to agree.
  for (const glm::vec3& n : result->mesh.normals) EXPECT_NEAR(n.z, -1.0F, 1e-5F);
}

TEST(GlbReader, stripsFansAndMeshesWithoutIndicesAreRead) {
  std::string binary;
  for (const auto& p : {std::array{0.F, 0.F}, std::array{1.F, 0.F}, std::array{1.F, 1.F}, std::array{0.F, 1.F}})
    for (const float x : {p[0], p[1], 0.0F}) put(binary, x);
  json document = {{"asset", {{"version", "2.0"}}},
                   {"buffers", {{{"byteLength", 48}}}},
                   {"bufferViews", {{{"buffer", 0}, {"byteLength", 48}}}},
                   {"accessors", {{{"bufferView", 0}, {"componentType", 5126}, {"count", 4}, {"type", "VEC3"}}}},
                   {"meshes", {{{"primitives", {{{"attributes", {{"POSITION", 0}}}, {"mode", 6}}}}}}}};
  expectSquare(read("fan.glb", glb(document, binary)));
  document["meshes"][0]["primitives"][0]["mode"] = 5;
  auto strip = read("strip.glb", glb(document, binary));
  ASSERT_TRUE(strip) << strip.error().message;
  EXPECT_EQ(strip->mesh.triangleCount(), 2U);
}

TEST(GlbReader, materialColorsStandInAndTexturesWarn) {
  std::string binary;
  json document = squareDocument(binary);
  document["meshes"][0]["primitives"][0]["material"] = 0;
  document["materials"] = {
      {{"pbrMetallicRoughness", {{"baseColorFactor", {1, 0, 0, 1}}, {"baseColorTexture", {{"index", 0}}}}}}};
  auto result = read("square.glb", glb(document, binary));
  expectSquare(result);
  EXPECT_EQ(result->mesh.colors[3], glm::u8vec4(255, 0, 0, 255));
  ASSERT_EQ(result->file.warnings.size(), 1U);
  EXPECT_NE(result->file.warnings[0].find("a texture cannot be read"), std::string::npos);
}

TEST(GlbReader, unreadableContentIsRefusedByItsName) {
  std::string binary;
  const json good = squareDocument(binary);
  const auto refusal = [&](const json& document) { return errorOf("bad.glb", glb(document, binary)); };
  json d = good;
  d["accessors"][0]["count"] = 5;
  EXPECT_NE(refusal(d).find("POSITION: accessor 0 reaches past its buffer"), std::string::npos);
  d = good;
  d["nodes"] = {{{"children", {0}}, {"mesh", 0}}};
  EXPECT_NE(refusal(d).find("node 0 has two parents or is its own child"), std::string::npos);
  d = good;
  d["meshes"][0]["primitives"][0]["indices"] = 0;
  EXPECT_NE(refusal(d).find("indices are not unsigned integers"), std::string::npos);
}

// ---- Other files ----

/// A folder of one test, in which files lie beside each other.
class GltfFiles : public testing::Test {
 protected:
  std::string add(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder / name, std::ios::binary) << bytes;
    return folder / name;
  }
  base::Result<MeshFile> readSquare(const json& document, const std::string& name = "square.gltf") const {
    return support::readMesh(add(name, document.dump()));
  }
  std::string refusal(const json& document) const {
    const auto result = readSquare(document);
    EXPECT_FALSE(result);
    return result ? "" : result.error().message;
  }

  const support::TemporaryDirectory folder;
  std::string binary;
  json document = squareDocument(binary);
};

TEST_F(GltfFiles, buffersLieBesideTheFile) {
  add("the points.bin", binary);
  document["buffers"][0]["uri"] = "the%20points.bin";
  expectSquare(readSquare(document));
  document["buffers"][0]["uri"] = "./the points.bin?v=1.0";
  expectSquare(readSquare(document));
  document["buffers"][0]["uri"] = folder / "the points.bin";
  expectSquare(readSquare(document));
}

TEST_F(GltfFiles, theContentTellsThemFromOtherFiles) {
  document["buffers"][0]["uri"] = "points.bin";
  add("points.bin", binary);
  expectSquare(readSquare(document, "square.ply"));
  add("marked.dat", "\xEF\xBB\xBF\n  " + document.dump(2));
  expectSquare(support::readMesh(folder / "marked.dat"));
}

TEST_F(GltfFiles, buffersMayBeTextInTheFile) {
  document["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64(binary);
  expectSquare(readSquare(document));
  std::string percent = "data:,";
  for (const char c : binary) {
    constexpr const char* kDigits = "0123456789abcdef";
    percent += {'%', kDigits[static_cast<unsigned char>(c) >> 4], kDigits[static_cast<unsigned char>(c) & 15]};
  }
  document["buffers"][0]["uri"] = percent;
  expectSquare(readSquare(document));
  document["buffers"][0]["uri"] = "data:;base64,A-_A";
  EXPECT_NE(refusal(document).find("POSITION: accessor 0 lies in a data URI that is broken"), std::string::npos);
}

TEST_F(GltfFiles, aGlbMayNameOthers) {
  // The indices lie in the GLB, the points beside it.
  add("points.bin", binary);
  document["buffers"].push_back({{"byteLength", binary.size()}, {"uri", "points.bin"}});
  document["bufferViews"][0]["buffer"] = 1;
  add("square.glb", glb(document, std::string(64, 'x') + binary.substr(64)));
  expectSquare(support::readMesh(folder / "square.glb"));
}

TEST_F(GltfFiles, errorsNameTheOtherFile) {
  document["buffers"][0]["uri"] = "points.bin";
  EXPECT_NE(refusal(document).find(folder / "points.bin"), std::string::npos) << refusal(document);
  add("points.bin", binary.substr(0, 70));
  EXPECT_NE(refusal(document).find("indices: accessor 1 reaches past its buffer (truncated?)"), std::string::npos);
  document["buffers"][0]["uri"] = "https://example.org/points.bin";
  EXPECT_NE(refusal(document).find("lies at \"https://example.org/points.bin\", which is not fetched"),
            std::string::npos);
  document["buffers"][0].erase("uri");
  EXPECT_NE(refusal(document).find("reaches past its buffer"), std::string::npos);
}

// ---- Numbers ----

TEST(GltfNumbers, quantizedPositionsNormalsAndColorsAreRead) {
  // KHR_mesh_quantization: positions are −1 … 1 in 16 bits, twice as large as the square and around its middle.
  std::string binary;
  for (const auto& [x, y] : {std::pair{-1, -1}, {1, -1}, {1, 1}, {-1, 1}})
    for (const int c : {32767 * x, 32767 * y, 0, 0}) put(binary, static_cast<std::int16_t>(c));
  for (int v = 0; v < 4; ++v) binary += std::string{'\0', '\0', '\x7f', '\0'};
  for (const int i : {0, 1, 2, 0, 2, 3}) put(binary, static_cast<std::uint8_t>(i));
  json d = {{"asset", {{"version", "2.0"}}},
            {"extensionsRequired", {"KHR_mesh_quantization"}},
            {"buffers", {{{"byteLength", binary.size()}}}},
            {"bufferViews",
             {{{"buffer", 0}, {"byteLength", 32}, {"byteStride", 8}},
              {{"buffer", 0}, {"byteOffset", 32}, {"byteLength", 16}, {"byteStride", 4}},
              {{"buffer", 0}, {"byteOffset", 48}, {"byteLength", 6}}}},
            {"accessors",
             {{{"bufferView", 0}, {"componentType", 5122}, {"count", 4}, {"type", "VEC3"}, {"normalized", true}},
              {{"bufferView", 1}, {"componentType", 5120}, {"count", 4}, {"type", "VEC3"}, {"normalized", true}},
              {{"bufferView", 2}, {"componentType", 5121}, {"count", 6}, {"type", "SCALAR"}}}},
            {"meshes", {{{"primitives", {{{"attributes", {{"POSITION", 0}, {"NORMAL", 1}}}, {"indices", 2}}}}}}},
            {"nodes", {{{"mesh", 0}, {"translation", {0.5, 0.5, 0}}, {"scale", {0.5, 0.5, 0.5}}}}}};
  const auto result = read("square.glb", glb(d, binary));
  expectSquare(result);
  EXPECT_TRUE(result->file.has_normals);
  EXPECT_TRUE(result->file.warnings.empty());

  // As whole numbers they are scaled by the node alone.
  d["accessors"][0]["normalized"] = false;
  const double step = 0.5 / 32767.0;
  d["nodes"][0]["scale"] = {step, step, step};
  expectSquare(read("square.glb", glb(d, binary)));
}

TEST(GltfNumbers, sparseAccessorsReplaceSinglePoints) {
  std::string binary;
  json d = squareDocument(binary);
  // Point 2 is far away until it is replaced.
  float far = 50.0F;
  std::memcpy(binary.data() + 32, &far, sizeof(far));
  const std::size_t at = binary.size();
  put(binary, std::uint16_t{2});
  put(binary, std::uint16_t{0});
  for (const float x : {1.0F, 1.0F, 0.0F}) put(binary, x);
  d["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", at}, {"byteLength", 2}});
  d["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", at + 4}, {"byteLength", 12}});
  d["accessors"][0]["sparse"] = {
      {"count", 1}, {"indices", {{"bufferView", 3}, {"componentType", 5123}}}, {"values", {{"bufferView", 4}}}};
  expectSquare(read("square.glb", glb(d, binary)));

  json bad = d;
  bad["accessors"][0]["sparse"]["count"] = 2;
  EXPECT_NE(errorOf("bad.glb", glb(bad, binary)).find("accessor 0 reaches past its buffer"), std::string::npos);
  std::string wrong = binary;
  wrong[at] = 4;
  EXPECT_NE(errorOf("bad.glb", glb(d, wrong)).find("is sparse and has an index that is out of range"),
            std::string::npos);
}

TEST(GltfNumbers, sparseAccessorsMayStandOnZeros) {
  std::string binary;
  json d = squareDocument(binary);
  const std::size_t at = binary.size();
  for (const int i : {1, 2, 3, 0}) put(binary, static_cast<std::uint8_t>(i));
  for (const auto& p : {std::array{1.F, 0.F}, std::array{1.F, 1.F}, std::array{0.F, 1.F}})
    for (const float x : {p[0], p[1], 0.0F}) put(binary, x);
  d["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", at}, {"byteLength", 3}});
  d["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", at + 4}, {"byteLength", 36}});
  d["accessors"][0].erase("bufferView");
  d["accessors"][0]["sparse"] = {
      {"count", 3}, {"indices", {{"bufferView", 3}, {"componentType", 5121}}}, {"values", {{"bufferView", 4}}}};
  expectSquare(read("square.glb", glb(d, binary)));
  d["accessors"][0]["count"] = 4000000000U;
  EXPECT_NE(errorOf("bad.glb", glb(d, binary)).find("is sparse and has more than 16777216 elements"),
            std::string::npos);
}

// ---- Textures ----

/// Keeps where the corners of textured triangles lie in their pictures.
class PlacesSink : public mesh::MeshSink {
 public:
  base::Result<void> vertices(const mesh::VertexBlock&) override { return {}; }
  base::Result<void> triangles(const mesh::TriangleBlock& block) override {
    places.insert(places.end(), block.uv.begin(), block.uv.end());
    return {};
  }
  base::Result<void> restart() override { return {}; }
  std::vector<glm::vec2> places;
};

/// The square with two sets of texture coordinates, of which the first is its own x and y.
class GltfTextures : public GltfFiles {
 protected:
  GltfTextures() {
    base::Image image(2, 2, 3);
    std::fill(image.pixels.begin(), image.pixels.end(), std::uint8_t{200});
    EXPECT_TRUE(base::writePng(image, folder / "picture.png"));
    std::ifstream file(folder / "picture.png", std::ios::binary);
    png.assign(std::istreambuf_iterator<char>(file), {});
    const std::size_t at = binary.size();
    for (const int i : {0, 0, 255, 0, 255, 255, 0, 255}) put(binary, static_cast<std::uint8_t>(i));
    for (int i = 0; i < 8; ++i) put(binary, 0.25F);
    document["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", at}, {"byteLength", 8}});
    document["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", at + 8}, {"byteLength", 32}});
    document["accessors"].push_back(
        {{"bufferView", 3}, {"componentType", 5121}, {"count", 4}, {"type", "VEC2"}, {"normalized", true}});
    document["accessors"].push_back({{"bufferView", 4}, {"componentType", 5126}, {"count", 4}, {"type", "VEC2"}});
    json& primitive = document["meshes"][0]["primitives"][0];
    primitive["attributes"]["TEXCOORD_0"] = 3;
    primitive["attributes"]["TEXCOORD_1"] = 4;
    primitive["material"] = 0;
    document["materials"] = {{{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}};
    document["textures"] = {{{"source", 0}}};
    document["images"] = {{{"uri", "picture.png"}}};
    add("square.bin", binary);
    document["buffers"][0] = {{"byteLength", binary.size()}, {"uri", "square.bin"}};
  }
  json& texture() { return document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]; }
  /// The places of the square's corners 0, 1 and 2.
  std::vector<glm::vec2> places() {
    PlacesSink sink;
    const auto read = mesh::streamMesh(add("square.gltf", document.dump()), sink, {});
    EXPECT_TRUE(read) << read.error().message;
    if (sink.places.size() == 6) sink.places.resize(3);
    EXPECT_EQ(sink.places.size(), 3U);
    return sink.places;
  }
  /// The square's picture, decoded from where the reader says that it lies.
  base::Result<base::Image> picture(const std::string& path) {
    PlacesSink sink;
    LUMIGRID_ASSIGN_OR_RETURN(const auto file, mesh::streamMesh(path, sink, {}));
    EXPECT_EQ(file.pictures.size(), 1U);
    EXPECT_TRUE(file.warnings.empty()) << file.warnings[0];
    if (file.pictures.empty()) return base::Error{};
    return mesh::readPicture(file.pictures[0]);
  }
  void expectGrey(const base::Result<base::Image>& image) {
    ASSERT_TRUE(image) << image.error().message;
    EXPECT_EQ(image->width, 2);
    EXPECT_EQ(image->pixels[0], 200);
  }

  std::string png;
};

void expectPlaces(const std::vector<glm::vec2>& got, const std::vector<glm::vec2>& wanted) {
  ASSERT_EQ(got.size(), wanted.size());
  for (std::size_t i = 0; i < got.size(); ++i)
    EXPECT_LT(glm::distance(got[i], wanted[i]), 1e-6F) << i << ": " << got[i].x << " " << got[i].y;
}

TEST_F(GltfTextures, takeTheSetOfCoordinatesThatTheMaterialNames) {
  expectPlaces(places(), {{0, 0}, {1, 0}, {1, 1}});
  texture()["texCoord"] = 1;
  expectPlaces(places(), {{0.25, 0.25}, {0.25, 0.25}, {0.25, 0.25}});
}

TEST_F(GltfTextures, haveAnAlphaOnlyWhereTheMaterialSaysSo) {
  const auto isOpaque = [&] {
    PlacesSink sink;
    const auto file = mesh::streamMesh(add("square.gltf", document.dump()), sink, {});
    EXPECT_TRUE(file && file->pictures.size() == 1);
    return file && file->pictures.size() == 1 && file->pictures[0].opaque;
  };
  EXPECT_TRUE(isOpaque());
  document["materials"][0]["alphaMode"] = "OPAQUE";
  EXPECT_TRUE(isOpaque());
  for (const char* mode : {"MASK", "BLEND"}) {
    document["materials"][0]["alphaMode"] = mode;
    EXPECT_FALSE(isOpaque()) << mode;
  }
}

TEST_F(GltfTextures, areMovedTurnedAndScaledInTheirExtensionsOrder) {
  // The extension's own example: the lower left quarter of the picture, turned by 90°.
  texture()["extensions"]["KHR_texture_transform"] = {
      {"offset", {0, 1}}, {"rotation", std::acos(0.0)}, {"scale", {0.5, 0.5}}};
  expectPlaces(places(), {{0, 1}, {0, 0.5}, {0.5, 0.5}});
  // Scaled by different factors before they are turned.
  texture()["extensions"]["KHR_texture_transform"] = {{"rotation", std::acos(0.0)}, {"scale", {2, 3}}};
  expectPlaces(places(), {{0, 0}, {0, -2}, {3, -2}});
  texture()["extensions"]["KHR_texture_transform"] = {{"texCoord", 1}, {"offset", {0.5, 0}}};
  expectPlaces(places(), {{0.75, 0.25}, {0.75, 0.25}, {0.75, 0.25}});
}

TEST_F(GltfTextures, mayBeTextInTheFile) {
  document["images"][0] = {{"uri", "data:image/png;base64," + base64(png)}};
  expectGrey(picture(add("square.gltf", document.dump())));

  // Some programs write "\\/" in JSON.
  std::string text = document.dump();
  for (std::size_t at = 0; (at = text.find('/', at)) != std::string::npos; at += 2) text.insert(at, "\\");
  expectGrey(picture(add("escaped.gltf", text)));

  document["buffers"][0].erase("uri");
  expectGrey(picture(add("square.glb", glb(document, binary))));
}

TEST_F(GltfTextures, mayLieInAnOutsideBuffer) {
  add("pictures.bin", "1234567" + png + "8");
  document["buffers"].push_back({{"byteLength", png.size() + 8}, {"uri", "pictures.bin"}});
  document["bufferViews"].push_back({{"buffer", 1}, {"byteOffset", 7}, {"byteLength", png.size()}});
  document["images"][0] = {{"bufferView", 5}, {"mimeType", "image/png"}};
  expectGrey(picture(add("square.gltf", document.dump())));
}

TEST_F(GltfTextures, thatAreNotReadAreCountedInOneLine) {
  const auto warning = [&] {
    const auto file = readSquare(document);
    EXPECT_TRUE(file) << file.error().message;
    EXPECT_TRUE(file->file.pictures.empty());
    EXPECT_EQ(file->file.warnings.size(), 1U);
    return file->file.warnings.empty() ? "" : file->file.warnings[0];
  };
  document["images"][0] = {{"uri", "https://example.org/a.png"}};
  EXPECT_EQ(warning(),
            "a texture cannot be read, vertex colours stay: it lies at \"https://example.org/a.png\", which is not "
            "fetched");
  json primitive = document["meshes"][0]["primitives"][0];
  primitive["material"] = 1;
  document["meshes"][0]["primitives"].push_back(primitive);
  document["materials"].push_back({{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 1}}}}}});
  EXPECT_EQ(warning().find("2 textures cannot be read, vertex colours stay; of the first: it lies at"), 0U);
}

TEST_F(GltfTextures, areRefusedByNameWhereTheyAreKtx2) {
  document["textures"][0] = {{"extensions", {{"KHR_texture_basisu", {{"source", 0}}}}}};
  const auto file = readSquare(document);
  ASSERT_TRUE(file) << file.error().message;
  ASSERT_EQ(file->file.warnings.size(), 1U);
  EXPECT_NE(file->file.warnings[0].find("it is KTX2 (KHR_texture_basisu)"), std::string::npos);
  // The plain picture beside it is taken.
  document["textures"][0]["source"] = 0;
  EXPECT_TRUE(readSquare(document)->file.warnings.empty());
  document["extensionsRequired"] = {"KHR_texture_basisu"};
  EXPECT_NE(refusal(document).find("its textures are KTX2 (KHR_texture_basisu), which is not read"), std::string::npos);
}

// ---- Extensions ----

TEST_F(GltfFiles, extensionsThatAreNotReadAreNamed) {
  document["buffers"][0]["uri"] = "data:;base64," + base64(binary);
  document["extensionsRequired"] = {"EXT_mesh_gpu_instancing", "KHR_materials_unlit", "VENDOR_thing"};
  const auto file = readSquare(document);
  expectSquare(file);
  ASSERT_EQ(file->file.warnings.size(), 1U);
  EXPECT_NE(file->file.warnings[0].find("it requires the extension \"VENDOR_thing\", which is not known"),
            std::string::npos);
}

TEST_F(GltfFiles, manyInstancesOfOneMeshAreCounted) {
  document["buffers"][0]["uri"] = "data:;base64," + base64(binary);
  document["nodes"] = json::array();
  document["scenes"][0]["nodes"] = json::array();
  for (int n = 0; n < 500001; ++n) {
    document["nodes"].push_back({{"mesh", 0}});
    document["scenes"][0]["nodes"].push_back(n);
  }
  PlacesSink sink;
  const auto file = mesh::streamMesh(add("many.gltf", document.dump()), sink, {});
  ASSERT_TRUE(file) << file.error().message;
  ASSERT_EQ(file->warnings.size(), 1U);
  EXPECT_EQ(file->warnings[0], "its nodes show meshes many times: 2 triangles in the file become 1000002");
}

TEST_F(GltfFiles, readingTellsProgressAndCanBeCancelled) {
  document["buffers"][0]["uri"] = "data:;base64," + base64(binary);
  const std::string path = add("square.gltf", document.dump());
  PlacesSink sink;
  mesh::StreamOptions options;
  double last = 0.0;
  options.progress = [&](double share) {
    last = share;
    return true;
  };
  ASSERT_TRUE(mesh::streamMesh(path, sink, options));
  EXPECT_EQ(last, 1.0);
  options.progress = [](double) { return false; };
  const auto cancelled = mesh::streamMesh(path, sink, options);
  ASSERT_FALSE(cancelled);
  EXPECT_EQ(cancelled.error().code, base::ErrorCode::kCancelled);
}

}  // namespace
