// GLB files as the project's own reader understands them, and as their bytes lie.
#include "server/export/glb.h"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "base/file.h"
#include "base/jpeg/jpeg.h"
#include "tests/server/export/export_testing.h"
#include "tests/support/temporary_directory.h"

namespace {

using export_testing::readBack;
using nlohmann::json;
using server::exports::GlbPrimitive;
using server::exports::GlbWriter;
using server::exports::linearFromSrgb;

// A square of two triangles in the plane z = 0.
GlbPrimitive square() {
  GlbPrimitive p;
  p.positions = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  p.indices = {0, 1, 2, 0, 2, 3};
  return p;
}

std::uint32_t numberAt(const base::Bytes& bytes, std::size_t offset) {
  base::ByteReader reader(base::ByteView(bytes).subspan(offset));
  return reader.u32();
}

json documentOf(const base::Bytes& bytes) {
  const auto* text = reinterpret_cast<const char*>(bytes.data()) + 20;
  return json::parse(text, text + numberAt(bytes, 12));
}

class Glb : public testing::Test {
 protected:
  base::Bytes written(const GlbWriter& writer, const glm::dmat4& matrix = glm::dmat4(1.0)) {
    const auto bytes = writer.write(path(), matrix);
    EXPECT_TRUE(bytes) << bytes.error().message;
    auto file = *base::readFile(path());
    EXPECT_EQ(*bytes, file.size());
    return file;
  }
  std::string path() const { return directory_ / "a.glb"; }
  support::TemporaryDirectory directory_;
};

TEST_F(Glb, colorsComeBackAsTheyWere) {
  GlbWriter writer({.unlit = true});
  for (int level = 0; level < 256; level += 4) {
    GlbPrimitive p = square();
    for (int v = 0; v < 4; ++v) p.colors.emplace_back(linearFromSrgb(static_cast<std::uint8_t>(level + v)));
    writer.add(p);
  }
  written(writer);
  const auto mesh = readBack(path());
  ASSERT_EQ(mesh.colors.size(), 256U);
  for (int level = 0; level < 256; ++level)
    EXPECT_NEAR(mesh.colors[static_cast<std::size_t>(level)].g, level, 1) << level;
}

TEST_F(Glb, positionsAndNormalsAreTurnedByTheMatrix) {
  GlbPrimitive p = square();
  p.normals.assign(4, {0, 0, 1});
  GlbWriter writer({});
  writer.add(p);
  const glm::dmat4 matrix{{1, 0, 0, 0}, {0, 0, -1, 0}, {0, 1, 0, 0}, {0.25, 500000.125, -7.5, 1}};
  written(writer, matrix);
  const auto mesh = readBack(path());
  EXPECT_EQ(mesh.positions[2], glm::dvec3(1.25, 500000.125, -8.5));
  EXPECT_EQ(mesh.normals[2], glm::vec3(0, 1, 0));
}

TEST_F(Glb, statesItsLengthsInMultiplesOfFour) {
  for (std::size_t length = 1; length <= 4; ++length) {
    GlbWriter writer({.unlit = false, .copyright = std::string(length, 'x')});
    GlbPrimitive p = square();
    p.indices.resize(3);  // 6 bytes
    writer.add(p);
    const base::Bytes file = written(writer);
    const std::size_t text = numberAt(file, 12), binary = numberAt(file, 20 + text);
    EXPECT_EQ(numberAt(file, 0), 0x46546C67U);
    EXPECT_EQ(numberAt(file, 8), file.size());
    EXPECT_EQ(text % 4, 0U);
    EXPECT_EQ(binary % 4, 0U);
    EXPECT_EQ(28 + text + binary, file.size());
    const json document = documentOf(file);
    for (const json& view : document["bufferViews"]) EXPECT_EQ(view["byteOffset"].get<int>() % 4, 0);
  }
}

TEST_F(Glb, positionsHaveTheirSmallestBox) {
  GlbWriter writer({});
  GlbPrimitive p = square();
  p.positions[3] = {-0.1F, 1.0F, 3.0F};
  writer.add(p);
  const json position = documentOf(written(writer))["accessors"][0];
  EXPECT_EQ(position["min"][0].get<float>(), -0.1F);
  EXPECT_EQ(position["max"].get<std::vector<float>>(), (std::vector<float>{1.0F, 1.0F, 3.0F}));
}

TEST_F(Glb, indicesAreShortUnlessThereAreTooManyVertices) {
  GlbWriter writer({});
  for (const std::size_t vertices : {65535, 65536}) {
    GlbPrimitive p;
    p.positions.assign(vertices, glm::vec3(0));
    p.positions.back() = {1, 2, 3};
    p.indices = {0, 1, static_cast<std::uint32_t>(vertices - 1)};
    writer.add(p);
  }
  const json j = documentOf(written(writer));
  EXPECT_EQ(j["accessors"][1]["componentType"], 5123);
  EXPECT_EQ(j["accessors"][3]["componentType"], 5125);
  const auto mesh = readBack(path());
  EXPECT_EQ(mesh.positions[mesh.indices[2]], glm::dvec3(1, 2, 3));
  EXPECT_EQ(mesh.positions[mesh.indices[5]], glm::dvec3(1, 2, 3));
}

TEST_F(Glb, primitivesWithAPictureHaveAMaterialOfTheirOwnThatIsClamped) {
  GlbWriter writer({.unlit = true});
  writer.add(square());
  GlbPrimitive p = square();
  p.places = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  base::Image red(8, 8, 3);
  for (std::size_t i = 0; i < red.pixels.size(); i += 3) red.pixels[i] = 200;
  p.picture = *base::encodeJpeg(red, 90, base::Subsampling::k444);
  writer.add(p);
  writer.add(p);
  writer.add(square());
  const json j = documentOf(written(writer));
  std::vector<int> materials;
  for (const json& primitive : j["meshes"][0]["primitives"]) materials.push_back(primitive["material"]);
  EXPECT_EQ(materials, (std::vector<int>{0, 1, 2, 0}));
  EXPECT_EQ(j["samplers"][0]["wrapS"], 33071);
  EXPECT_EQ(j["images"].size(), 2U);
  EXPECT_EQ(j["extensionsUsed"], json::parse(R"(["KHR_materials_unlit"])"));

  const auto mesh = readBack(path());
  ASSERT_EQ(mesh.colors.size(), 16U);
  EXPECT_NEAR(mesh.colors[4].r, 200, 2);
  EXPECT_NEAR(mesh.colors[4].g, 0, 2);
}

}  // namespace
