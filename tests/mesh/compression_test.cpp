// Compressed glTF is what the encoders of meshoptimizer and Draco write, and comes in as it was before.
#include <draco/compression/expert_encode.h>
#include <draco/mesh/triangle_soup_mesh_builder.h>
#include <meshoptimizer.h>
#include <webp/encode.h>

#include <cmath>

#include "mesh/texture.h"
#include "tests/mesh/gltf_files.h"

namespace {

using namespace mesh_files;

// ---- meshoptimizer ----

std::string encodedVertices(const std::string& raw, std::size_t stride) {
  const std::size_t count = raw.size() / stride;
  std::string out(meshopt_encodeVertexBufferBound(count, stride), '\0');
  auto* to = reinterpret_cast<unsigned char*>(out.data());
  out.resize(meshopt_encodeVertexBuffer(to, out.size(), raw.data(), count, stride));
  return out;
}

std::string encodedTriangles(const std::vector<unsigned int>& indices) {
  std::string out(meshopt_encodeIndexBufferBound(indices.size(), 4), '\0');
  auto* to = reinterpret_cast<unsigned char*>(out.data());
  out.resize(meshopt_encodeIndexBuffer(to, out.size(), indices.data(), indices.size()));
  return out;
}

std::string encodedSequence(const std::vector<unsigned int>& indices) {
  std::string out(meshopt_encodeIndexSequenceBound(indices.size(), 4), '\0');
  auto* to = reinterpret_cast<unsigned char*>(out.data());
  out.resize(meshopt_encodeIndexSequence(to, out.size(), indices.data(), indices.size()));
  return out;
}

/// A document whose views are compressed one by one. Its second buffer, which holds the views as they were, is not
/// there.
class Meshopt {
 public:
  explicit Meshopt(std::string extension = "EXT_meshopt_compression") : extension_(std::move(extension)) {
    document = {{"asset", {{"version", "2.0"}}}, {"extensionsRequired", {extension_}}};
    document["buffers"] = {{{"byteLength", 0}},
                           {{"byteLength", 0}, {"extensions", {{extension_, {{"fallback", true}}}}}}};
  }
  /// Adds an accessor on a view of its own.
  int add(const std::string& bytes, std::size_t stride, std::size_t count, const std::string& mode,
          const json& accessor, const std::string& filter = "") {
    json compression = {{"buffer", 0},
                        {"byteOffset", binary_.size()},
                        {"byteLength", bytes.size()},
                        {"byteStride", stride},
                        {"count", count},
                        {"mode", mode}};
    if (!filter.empty()) compression["filter"] = filter;
    binary_ += bytes;
    json view = {{"buffer", 1}, {"byteOffset", 0}, {"byteLength", stride * count}};
    view["extensions"][extension_] = compression;
    document["bufferViews"].push_back(view);
    json full = accessor;
    full["bufferView"] = document["bufferViews"].size() - 1;
    full["count"] = count;
    document["accessors"].push_back(full);
    return static_cast<int>(document["accessors"].size()) - 1;
  }
  json& compression(int view) {
    return document["bufferViews"][static_cast<std::size_t>(view)]["extensions"][extension_];
  }
  std::string file() const { return glb(document, binary_); }

  json document;

 private:
  std::string extension_;
  std::string binary_;
};

std::string squarePoints() {
  std::string raw;
  for (const auto& p : {std::array{0.F, 0.F}, std::array{1.F, 0.F}, std::array{1.F, 1.F}, std::array{0.F, 1.F}})
    for (const float x : {p[0], p[1], 0.0F}) put(raw, x);
  return raw;
}

const json kPoints = {{"componentType", 5126}, {"type", "VEC3"}};
const json kShorts = {{"componentType", 5123}, {"type", "SCALAR"}};

/// The square with its points, and its corners in 16 bits.
Meshopt meshoptSquare(const std::string& mode, const std::string& extension = "EXT_meshopt_compression") {
  Meshopt square(extension);
  const std::vector<unsigned int> corners{0, 1, 2, 0, 2, 3};
  const int points = square.add(encodedVertices(squarePoints(), 12), 12, 4, "ATTRIBUTES", kPoints);
  const std::string encoded = mode == "TRIANGLES" ? encodedTriangles(corners) : encodedSequence(corners);
  const int indices = square.add(encoded, 2, 6, mode, kShorts);
  square.document["meshes"] = {{{"primitives", {{{"attributes", {{"POSITION", points}}}, {"indices", indices}}}}}};
  return square;
}

TEST(MeshoptCompression, verticesTrianglesAndSequencesAreDecoded) {
  for (const char* const mode : {"TRIANGLES", "INDICES"})
    for (const char* const extension : {"EXT_meshopt_compression", "KHR_meshopt_compression"}) {
      const auto result = read("square.glb", meshoptSquare(mode, extension).file());
      expectSquare(result);
      EXPECT_TRUE(result->file.warnings.empty()) << mode;
    }
}

TEST(MeshoptCompression, filtersGiveNormalsAndPositionsBack) {
  Meshopt square;
  // Mantissas of 16 bits and a common exponent hold the square without loss, and three components leave no gap.
  const std::string points = squarePoints();
  std::string exponents(points.size(), '\0');
  meshopt_encodeFilterExp(exponents.data(), 4, 12, 16, reinterpret_cast<const float*>(points.data()));
  std::string normals;
  for (int v = 0; v < 4; ++v)
    for (const float x : {0.0F, 0.0F, 1.0F, 0.0F}) put(normals, x);
  std::string octahedral(16, '\0');
  meshopt_encodeFilterOct(octahedral.data(), 4, 4, 8, reinterpret_cast<const float*>(normals.data()));
  const int position = square.add(encodedVertices(exponents, 12), 12, 4, "ATTRIBUTES", kPoints, "EXPONENTIAL");
  const int normal = square.add(encodedVertices(octahedral, 4), 4, 4, "ATTRIBUTES",
                                {{"componentType", 5120}, {"type", "VEC3"}, {"normalized", true}}, "OCTAHEDRAL");
  const int indices = square.add(encodedTriangles({0, 1, 2, 0, 2, 3}), 4, 6, "TRIANGLES",
                                 {{"componentType", 5125}, {"type", "SCALAR"}});
  square.document["meshes"] = {
      {{"primitives", {{{"attributes", {{"POSITION", position}, {"NORMAL", normal}}}, {"indices", indices}}}}}};
  const auto result = read("square.glb", square.file());
  expectSquare(result);
  EXPECT_TRUE(result->file.has_normals);
}

TEST(MeshoptCompression, severalPrimitivesShareAView) {
  Meshopt square = meshoptSquare("TRIANGLES");
  json& primitives = square.document["meshes"][0]["primitives"];
  primitives.push_back(primitives[0]);
  const auto result = read("square.glb", square.file());
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_EQ(result->file.triangles, 4U);
}

TEST(MeshoptCompression, brokenBytesAreErrors) {
  const auto refusal = [](Meshopt& square) { return errorOf("bad.glb", square.file()); };
  const std::string broken = "mesh 0 primitive 0: POSITION: accessor 0 is compressed by meshoptimizer and broken";
  Meshopt square = meshoptSquare("TRIANGLES");
  square.compression(0)["byteLength"] = 20;
  EXPECT_NE(refusal(square).find(broken), std::string::npos);
  for (const std::uint64_t count : {std::uint64_t{0}, std::uint64_t{3}, std::uint64_t{4000000000}, ~std::uint64_t{0}}) {
    square = meshoptSquare("TRIANGLES");
    square.compression(0)["count"] = count;
    EXPECT_FALSE(refusal(square).empty()) << count;
  }
  for (const int stride : {0, 13, 260}) {
    square = meshoptSquare("TRIANGLES");
    square.compression(0)["byteStride"] = stride;
    EXPECT_NE(refusal(square).find(broken), std::string::npos) << stride;
  }
  square = meshoptSquare("TRIANGLES");
  square.compression(1)["count"] = 5;
  EXPECT_NE(refusal(square).find("indices: accessor 1 is compressed by meshoptimizer and broken"), std::string::npos);
  square = meshoptSquare("TRIANGLES");
  square.compression(0)["byteOffset"] = 4000;
  EXPECT_NE(refusal(square).find("reaches past its buffer"), std::string::npos);
}

TEST(MeshoptCompression, unknownModesFiltersAndVersionsAreNamed) {
  const auto refusal = [](Meshopt& square) { return errorOf("bad.glb", square.file()); };
  Meshopt square = meshoptSquare("TRIANGLES");
  square.compression(0)["mode"] = "CLUSTERS";
  EXPECT_NE(refusal(square).find("in the mode \"CLUSTERS\", which is not read"), std::string::npos);
  square = meshoptSquare("TRIANGLES");
  square.compression(0)["filter"] = "COLOR";
  EXPECT_NE(refusal(square).find("with the filter \"COLOR\" of 12 bytes, which is not read"), std::string::npos);

  // The vertex codec's version stands in its first byte.
  Meshopt later("KHR_meshopt_compression");
  std::string points = encodedVertices(squarePoints(), 12);
  points[0] = '\xa1';
  const int position = later.add(points, 12, 4, "ATTRIBUTES", kPoints);
  later.document["meshes"] = {{{"primitives", {{{"attributes", {{"POSITION", position}}}, {"mode", 6}}}}}};
  EXPECT_NE(refusal(later).find("compressed by a later version of meshoptimizer, which is not read"),
            std::string::npos);
}

// ---- Draco ----

struct DracoSquare {
  std::string bytes;
  int position = 0, normal = 0, color = 0;  // the numbers of its attributes
};

DracoSquare dracoSquare(int quantization) {
  const float points[4][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  const std::uint8_t colors[4][4] = {{255, 0, 55, 255}, {0, 0, 0, 255}, {0, 255, 0, 255}, {1, 2, 3, 255}};
  const float up[3] = {0, 0, 1};
  draco::TriangleSoupMeshBuilder builder;
  builder.Start(2);
  const int position = builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  const int normal = builder.AddAttribute(draco::GeometryAttribute::NORMAL, 3, draco::DT_FLOAT32);
  const int color = builder.AddAttribute(draco::GeometryAttribute::COLOR, 4, draco::DT_UINT8);
  const int triangles[2][3] = {{0, 1, 2}, {0, 2, 3}};
  for (std::uint32_t f = 0; f < 2; ++f) {
    const int* t = triangles[f];
    builder.SetAttributeValuesForFace(position, draco::FaceIndex(f), points[t[0]], points[t[1]], points[t[2]]);
    builder.SetAttributeValuesForFace(normal, draco::FaceIndex(f), up, up, up);
    builder.SetAttributeValuesForFace(color, draco::FaceIndex(f), colors[t[0]], colors[t[1]], colors[t[2]]);
  }
  const std::unique_ptr<draco::Mesh> mesh = builder.Finalize();
  draco::ExpertEncoder encoder(*mesh);
  encoder.SetAttributeQuantization(position, quantization);
  encoder.SetAttributeQuantization(normal, 10);
  draco::EncoderBuffer buffer;
  EXPECT_TRUE(encoder.EncodeToBuffer(&buffer).ok());
  const auto number = [&](int attribute) { return static_cast<int>(mesh->attribute(attribute)->unique_id()); };
  return {{buffer.data(), buffer.size()}, number(position), number(normal), number(color)};
}

json dracoDocument(const DracoSquare& square) {
  const json compression = {
      {"bufferView", 0},
      {"attributes", {{"POSITION", square.position}, {"NORMAL", square.normal}, {"COLOR_0", square.color}}}};
  json primitive = {{"attributes", {{"POSITION", 0}, {"NORMAL", 1}, {"COLOR_0", 2}}}, {"indices", 3}};
  primitive["extensions"]["KHR_draco_mesh_compression"] = compression;
  return {{"asset", {{"version", "2.0"}}},
          {"extensionsRequired", {"KHR_draco_mesh_compression"}},
          {"buffers", {{{"byteLength", square.bytes.size()}}}},
          {"bufferViews", {{{"buffer", 0}, {"byteLength", square.bytes.size()}}}},
          {"accessors",
           {{{"componentType", 5126}, {"count", 4}, {"type", "VEC3"}},
            {{"componentType", 5126}, {"count", 4}, {"type", "VEC3"}},
            {{"componentType", 5121}, {"count", 4}, {"type", "VEC4"}, {"normalized", true}},
            {{"componentType", 5123}, {"count", 6}, {"type", "SCALAR"}}}},
          {"meshes", {{{"primitives", {primitive}}}}}};
}

TEST(DracoCompression, positionsNormalsAndColorsAreDecoded) {
  const DracoSquare square = dracoSquare(14);
  const auto result = read("square.glb", glb(dracoDocument(square), square.bytes));
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_TRUE(result->file.has_normals);
  EXPECT_TRUE(result->file.warnings.empty());
  EXPECT_EQ(result->file.triangles, 2U);
  ASSERT_EQ(result->mesh.positions.size(), 4U);

  // Draco numbers the points anew.
  const std::map<std::pair<long, long>, glm::u8vec4> wanted{
      {{0, 0}, {255, 0, 128, 255}}, {{1, 0}, {0, 0, 0, 255}}, {{1, 1}, {0, 255, 0, 255}}, {{0, 1}, {13, 22, 28, 255}}};
  for (std::size_t v = 0; v < 4; ++v) {
    const glm::vec3& p = result->mesh.positions[v];
    const std::pair<long, long> corner{std::lround(p.x), std::lround(p.y)};
    ASSERT_TRUE(wanted.contains(corner));
    EXPECT_LT(glm::distance(p, glm::vec3(static_cast<float>(corner.first), static_cast<float>(corner.second), 0.0F)),
              1e-4F);
    EXPECT_EQ(result->mesh.colors[v], wanted.at(corner)) << p.x << " " << p.y;
    EXPECT_LT(glm::distance(result->mesh.normals[v], glm::vec3(0.0F, 0.0F, 1.0F)), 1e-2F);
  }
}

TEST(DracoCompression, attributesThatAreNotCompressedStayAsTheyAre) {
  // The colours lie in a plain view, in the order of the decoded points, and are all the same.
  const DracoSquare square = dracoSquare(14);
  json d = dracoDocument(square);
  std::string binary = square.bytes;
  binary.resize((binary.size() + 3) / 4 * 4, '\0');
  const std::size_t at = binary.size();
  for (int v = 0; v < 4; ++v) binary += std::string{'\xff', '\0', '\x37', '\xff'};
  d["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", at}, {"byteLength", 16}});
  d["accessors"][2]["bufferView"] = 1;
  d["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]["attributes"].erase("COLOR_0");
  const auto result = read("square.glb", glb(d, binary));
  ASSERT_TRUE(result) << result.error().message;
  for (const glm::u8vec4& color : result->mesh.colors) EXPECT_EQ(color, glm::u8vec4(255, 0, 128, 255));
}

TEST(DracoCompression, brokenBytesAreErrors) {
  const DracoSquare square = dracoSquare(14);
  const json d = dracoDocument(square);
  for (std::size_t length = 0; length < square.bytes.size(); ++length) {
    json cut = d;
    cut["bufferViews"][0]["byteLength"] = length;
    const std::string message = errorOf("bad.glb", glb(cut, square.bytes));
    EXPECT_NE(message.find("mesh 0 primitive 0"), std::string::npos) << message;
  }
  for (std::size_t at = 0; at < square.bytes.size(); ++at)
    for (const char value : {'\0', '\1', '\x7f', '\xff'}) {
      std::string bytes = square.bytes;
      bytes[at] = value;
      (void)read("bad.glb", glb(d, bytes));
    }
  json missing = d;
  missing["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]["attributes"]["NORMAL"] = 77;
  EXPECT_NE(errorOf("bad.glb", glb(missing, square.bytes))
                .find("NORMAL is not among the attributes that are compressed by Draco"),
            std::string::npos);
}

// ---- WebP ----

TEST(WebpTextures, areReadWhereTheExtensionNamesThem) {
  const std::vector<std::uint8_t> red{250, 0, 0, 250, 0, 0, 250, 0, 0, 250, 0, 0};
  std::uint8_t* encoded = nullptr;
  const std::size_t size = WebPEncodeLosslessRGB(red.data(), 2, 2, 6, &encoded);
  ASSERT_GT(size, 0U);
  const std::string webp(reinterpret_cast<const char*>(encoded), size);
  WebPFree(encoded);
  std::string binary;
  json d = squareDocument(binary);
  const std::size_t at = binary.size();
  for (int i = 0; i < 8; ++i) put(binary, 0.5F);
  binary += webp;
  d["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", at}, {"byteLength", 32}});
  d["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", at + 32}, {"byteLength", size}});
  d["accessors"].push_back({{"bufferView", 3}, {"componentType", 5126}, {"count", 4}, {"type", "VEC2"}});
  d["images"] = {{{"uri", "none.png"}}, {{"bufferView", 4}, {"mimeType", "image/webp"}}};
  d["textures"] = {{{"source", 0}, {"extensions", {{"EXT_texture_webp", {{"source", 1}}}}}}};
  d["materials"] = {{{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}};
  json& primitive = d["meshes"][0]["primitives"][0];
  primitive["attributes"]["TEXCOORD_0"] = 3;
  primitive["material"] = 0;
  d["extensionsRequired"] = {"EXT_texture_webp"};
  const auto result = read("square.glb", glb(d, binary));
  expectSquare(result);
  EXPECT_TRUE(result->file.warnings.empty());
  for (const glm::u8vec4& color : result->mesh.colors) EXPECT_EQ(color, glm::u8vec4(250, 0, 0, 255));

  // Cut at any length, and with an alpha, they are pictures or errors.
  const auto view = [](const std::string& text) { return base::viewOfText(text); };
  for (std::size_t length = 12; length + 2 < webp.size(); ++length)
    EXPECT_FALSE(mesh::decodePicture(view(webp.substr(0, length)))) << length;
  const auto image = mesh::decodePicture(view(webp));
  ASSERT_TRUE(image);
  EXPECT_EQ(image->channels, 3);
}

TEST(KtxTextures, areRefusedByName) {
  const std::string ktx("\xABKTX 20\xBB\r\n\x1A\n", 12);
  const auto image = mesh::decodePicture(base::viewOfText(ktx));
  ASSERT_FALSE(image);
  EXPECT_NE(image.error().message.find("it is KTX, which is not read"), std::string::npos);
}

}  // namespace
