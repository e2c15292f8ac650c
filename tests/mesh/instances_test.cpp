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

}  // namespace
