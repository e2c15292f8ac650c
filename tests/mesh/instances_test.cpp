// glTF files that ask for more than they hold: instances, cycles, depths and counts without bytes behind them.
#include "mesh/gltf/instances.h"

#include "tests/mesh/gltf_files.h"

namespace {

using namespace mesh_files;

class HostileGltf : public testing::Test {
 protected:
  std::string error() const { return errorOf("hostile.glb", glb(document, binary)); }

  std::string binary;
  json document = squareDocument(binary);
};

// A strip of so many triangles, since a byte of a file can be a corner.
void writeStrip(std::size_t triangles, json& document, std::string& binary) {
  binary.clear();
  for (std::size_t v = 0; v < 3; ++v)
    for (const float x : {v == 1 ? 1.0F : 0.0F, v == 2 ? 1.0F : 0.0F, 0.0F}) put(binary, x);
  for (std::size_t c = 0; c < triangles + 2; ++c) put(binary, static_cast<std::uint8_t>(c % 3));
  document["bufferViews"] = {{{"buffer", 0}, {"byteOffset", 0}, {"byteLength", 36}},
                             {{"buffer", 0}, {"byteOffset", 36}, {"byteLength", triangles + 2}}};
  document["accessors"] = {{{"bufferView", 0}, {"componentType", 5126}, {"count", 3}, {"type", "VEC3"}},
                           {{"bufferView", 1}, {"componentType", 5121}, {"count", triangles + 2}, {"type", "SCALAR"}}};
  document["meshes"] = {{{"primitives", {{{"attributes", {{"POSITION", 0}}}, {"indices", 1}, {"mode", 5}}}}}};
}

TEST_F(HostileGltf, moreInstancesThanAnyoneMeansAreRefusedWithTheirNumber) {
  // 100 000 triangles, shown 600 times: 60 million, refused before any of them is read.
  writeStrip(100'000, document, binary);
  document["nodes"] = json::array();
  document["scenes"][0]["nodes"] = json::array();
  for (int n = 0; n < 600; ++n) {
    document["nodes"].push_back({{"mesh", 0}});
    document["scenes"][0]["nodes"].push_back(n);
  }
  EXPECT_NE(error().find("instances make 60000000 triangles of the 100000 that the file holds; up to 50000000, or 64 "
                         "times those in the file, are read; write fewer instances, or all of them as meshes"),
            std::string::npos);
}

TEST_F(HostileGltf, primitivesThatShareTheirBytesAreInstancesToo) {
  writeStrip(100'000, document, binary);
  const json primitive = document["meshes"][0]["primitives"][0];
  for (int p = 1; p < 600; ++p) {
    // Each has an accessor of its own, but the bytes are the same.
    document["accessors"].push_back(document["accessors"][1]);
    document["meshes"][0]["primitives"].push_back(primitive);
    document["meshes"][0]["primitives"].back()["indices"] = p + 1;
  }
  EXPECT_NE(error().find("make 60000000 triangles of the 100000"), std::string::npos);
}

TEST_F(HostileGltf, verticesWithoutTrianglesAreInstancesToo) {
  document["accessors"][0] = {
      {"componentType", 5126},
      {"count", 1U << 24},
      {"type", "VEC3"},
      {"sparse",
       {{"count", 1}, {"indices", {{"bufferView", 1}, {"componentType", 5123}}}, {"values", {{"bufferView", 0}}}}}};
  document["nodes"] = {{{"mesh", 0}}, {{"mesh", 0}}, {{"mesh", 0}}, {{"mesh", 0}}};
  document["scenes"][0]["nodes"] = {0, 1, 2, 3};
  EXPECT_NE(error().find("instances make 67108864 vertices of the 1 that the file holds"), std::string::npos);
}

TEST_F(HostileGltf, aNodeThatIsMetTwiceIsAnError) {
  const json nodes = {{{"children", {1}}}, {{"mesh", 0}, {"children", {0}}}};
  document["nodes"] = nodes;
  EXPECT_NE(error().find("node 0 has two parents or is its own child"), std::string::npos);
  // A long list of the same child costs nothing.
  document["nodes"] = {{{"mesh", 0}, {"children", std::vector<int>(100'000, 1)}}, {{"mesh", 0}}};
  EXPECT_NE(error().find("node 1 has two parents or is its own child"), std::string::npos);
  document["nodes"][0]["children"] = {7};
  EXPECT_NE(error().find("a scene or node names a node that is not there"), std::string::npos);
}

TEST_F(HostileGltf, chainsOfNodesMayBeLong) {
  document["nodes"] = json::array();
  for (int n = 0; n < 200'000; ++n) document["nodes"].push_back({{"children", {n + 1}}, {"translation", {0, 0, 1}}});
  document["nodes"].push_back({{"mesh", 0}});
  const auto file = read("chain.glb", glb(document, binary));
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(file->file.triangles, 2U);
  EXPECT_EQ(file->mesh.origin.z + static_cast<double>(file->mesh.positions[0].z), 200'000.0);
}

TEST_F(HostileGltf, jsonOfAnyDepthIsReadOrRefused) {
  const std::size_t depth = 1'000'000;
  const std::string deep = std::string(depth, '[') + std::string(depth, ']');
  document["buffers"][0]["uri"] = "data:;base64," + base64(binary);
  std::string text = document.dump();
  text.insert(1, "\"extras\":" + deep + ",");
  const auto file = read("deep.gltf", text);
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(file->file.triangles, 2U);
  EXPECT_FALSE(read("cut.gltf", text.substr(0, depth)));
}

TEST_F(HostileGltf, countsWithoutBytesBehindThemAreRefused) {
  const std::uint64_t huge = ~std::uint64_t{0} - 7;
  for (const std::uint64_t count : {std::uint64_t{1} << 33, std::uint64_t{1} << 61, huge}) {
    json wrong = document;
    wrong["accessors"][0]["count"] = count;
    EXPECT_NE(errorOf("count.glb", glb(wrong, binary)), "");
    wrong = document;
    wrong["accessors"][1]["count"] = count;
    EXPECT_NE(errorOf("count.glb", glb(wrong, binary)), "");
    wrong = document;
    wrong["accessors"][0]["sparse"] = {
        {"count", count}, {"indices", {{"bufferView", 1}, {"componentType", 5123}}}, {"values", {{"bufferView", 0}}}};
    EXPECT_NE(errorOf("count.glb", glb(wrong, binary)), "");
    wrong = document;
    wrong["bufferViews"][0]["extensions"]["EXT_meshopt_compression"] = {
        {"buffer", 0}, {"byteLength", 64}, {"byteStride", 16}, {"mode", "ATTRIBUTES"}, {"count", count}};
    EXPECT_NE(errorOf("count.glb", glb(wrong, binary)), "");
  }
}

// ---- EXT_mesh_gpu_instancing

/// The square, shown where three translations, rotations of 16 bits and scales put it.
class GpuInstances : public testing::Test {
 protected:
  GpuInstances() {
    const std::size_t begin = binary.size();
    for (const float t : {0.0F, 0.0F, 0.0F, 5.0F, 0.0F, 0.0F, 0.0F, 7.0F, 0.0F}) put(binary, t);
    const std::size_t turns = binary.size();
    // No turn, half a turn around z, and no turn.
    for (const int q : {0, 0, 0, 32767, 0, 0, 32767, 0, 0, 0, 0, 32767}) put(binary, static_cast<std::int16_t>(q));
    const std::size_t scales = binary.size();
    for (const float s : {1.0F, 1.0F, 1.0F, 2.0F, 2.0F, 2.0F, -1.0F, 1.0F, 1.0F}) put(binary, s);
    document["buffers"][0]["byteLength"] = binary.size();
    for (const auto& [offset, length] :
         {std::pair{begin, turns - begin}, {turns, scales - turns}, {scales, binary.size() - scales}})
      document["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", offset}, {"byteLength", length}});
    document["accessors"].push_back({{"bufferView", 3}, {"componentType", 5126}, {"count", 3}, {"type", "VEC3"}});
    document["accessors"].push_back(
        {{"bufferView", 4}, {"componentType", 5122}, {"count", 3}, {"type", "VEC4"}, {"normalized", true}});
    document["accessors"].push_back({{"bufferView", 5}, {"componentType", 5126}, {"count", 3}, {"type", "VEC3"}});
    attributes() = {{"TRANSLATION", 3}, {"ROTATION", 4}, {"SCALE", 5}};
    document["nodes"][0]["translation"] = {100, 0, 0};
  }
  json& attributes() { return document["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]; }
  std::string error() const { return errorOf("instances.glb", glb(document, binary)); }

  std::string binary;
  json document = squareDocument(binary);
};

TEST_F(GpuInstances, standWhereTheirAttributesPutThem) {
  const auto file = read("instances.glb", glb(document, binary));
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(file->file.triangles, 6U);
  EXPECT_TRUE(file->file.warnings.empty());
  const auto corner = [&](std::size_t v) { return file->mesh.origin + glm::dvec3(file->mesh.positions[v]); };
  ASSERT_EQ(file->mesh.positions.size(), 12U);
  EXPECT_EQ(corner(2), glm::dvec3(101, 1, 0));
  EXPECT_LT(glm::distance(corner(6), glm::dvec3(103, -2, 0)), 1e-5);
  EXPECT_EQ(corner(10), glm::dvec3(99, 8, 0));
  // The mirrored one is turned over, so that all show the side that they had.
  for (std::size_t t = 0; t < 6; ++t) {
    const auto at = [&](std::size_t k) { return corner(file->mesh.indices[3 * t + k]); };
    EXPECT_GT(glm::cross(at(1) - at(0), at(2) - at(0)).z, 0.0) << t;
  }
}

TEST_F(GpuInstances, needNoAttributeOfPlace) {
  attributes() = {{"TRANSLATION", 3}, {"_ID", 5}};
  const auto file = read("instances.glb", glb(document, binary));
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(file->file.triangles, 6U);
  attributes() = json::object();
  EXPECT_EQ(read("instances.glb", glb(document, binary))->file.triangles, 2U);
}

TEST_F(GpuInstances, thatAreBrokenAreNamed) {
  document["accessors"][5]["count"] = 2;
  EXPECT_NE(error().find("node 0: the attributes of its instances have different numbers of elements"),
            std::string::npos);
  document["accessors"][5]["count"] = 4;
  EXPECT_NE(error().find("node 0: \"SCALE\" of its instances: accessor 5 reaches past its buffer"), std::string::npos)
      << error();
  document["accessors"][5]["count"] = 3;
  attributes()["ROTATION"] = 3;
  EXPECT_NE(error().find("node 0: \"ROTATION\" of its instances has 3 components"), std::string::npos);
}

TEST_F(GpuInstances, beyondWhatAnyoneMeansAreRefusedBeforeTheyAreRead) {
  writeStrip(100'000, document, binary);
  // 600 instances that stand on zeros, and so take no bytes.
  document["accessors"].push_back(
      {{"componentType", 5126},
       {"count", 600},
       {"type", "VEC3"},
       {"sparse",
        {{"count", 1}, {"indices", {{"bufferView", 1}, {"componentType", 5121}}}, {"values", {{"bufferView", 0}}}}}});
  attributes() = {{"TRANSLATION", 2}};
  EXPECT_NE(error().find("instances make 60000000 triangles of the 100000 that the file holds"), std::string::npos);
}

}  // namespace
