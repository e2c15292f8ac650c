// Implicit tiling: the tiles that bits in subtree files name come in as those that JSON lists do.
#include <filesystem>
#include <set>

#include "mesh/tiles/subtree.h"
#include "tests/mesh/gltf_files.h"

namespace {

using namespace mesh_files;
using mesh::tiles::ImplicitTiling;
using mesh::tiles::Subtree;

using Bits = std::vector<bool>;
using Places = std::set<std::pair<double, double>>;

/// A subtree file, whose bitstreams lie one behind another.
std::string subtreeFile(json root, const std::vector<Bits>& bitstreams) {
  std::string binary;
  root["bufferViews"] = json::array();
  for (const Bits& bits : bitstreams) {
    root["bufferViews"].push_back(
        {{"buffer", 0}, {"byteOffset", binary.size()}, {"byteLength", (bits.size() + 7) / 8}});
    std::string bytes((bits.size() + 7) / 8, '\0');
    for (std::size_t b = 0; b < bits.size(); ++b)
      if (bits[b]) bytes[b / 8] = static_cast<char>(bytes[b / 8] | 1 << b % 8);
    binary += bytes;
  }
  root["buffers"] = {{{"byteLength", binary.size()}}};
  const std::string text = root.dump();
  std::string file = "subt";
  put(file, std::uint32_t{1});
  put(file, std::uint64_t{text.size()});
  put(file, std::uint64_t{binary.size()});
  return file + text + binary;
}

json bitstream(int index) {
  return {{"bitstream", index}};
}
json constant(int value) {
  return {{"constant", value}};
}
json availability(json tiles, json contents, json subtrees) {
  return {{"tileAvailability", std::move(tiles)},
          {"contentAvailability", {std::move(contents)}},
          {"childSubtreeAvailability", std::move(subtrees)}};
}

class ImplicitTiles : public testing::Test {
 protected:
  void add(const std::string& name, const std::string& bytes) const {
    const std::string path = folder_ / name;
    std::filesystem::create_directories(std::filesystem::path(path).parent_path());
    std::ofstream(path, std::ios::binary) << bytes;
  }
  /// The content of a tile: a square that begins at (x, y).
  void addSquare(const std::string& name, double x, double y) const {
    std::string binary;
    json document = squareDocument(binary);
    document["nodes"][0]["translation"] = {x, 0, -y};  // glTF's −z is the tileset's y
    add(name, glb(document, binary));
  }
  static json quadtree(const std::string& refine, unsigned levels, unsigned subtree_levels) {
    return {{"refine", refine},
            {"boundingVolume", {{"box", {0, 0, 0, 10, 0, 0, 0, 10, 0, 0, 0, 10}}}},
            {"geometricError", 1},
            {"content", {{"uri", "c/{level}_{x}_{y}.glb"}}},
            {"implicitTiling",
             {{"subdivisionScheme", "QUADTREE"},
              {"subtreeLevels", subtree_levels},
              {"availableLevels", levels},
              {"subtrees", {{"uri", "s/{level}.{x}.{y}.subtree"}}}}}};
  }
  base::Result<Places> read(const json& root) const {
    add("tileset.json", json{{"asset", {{"version", "1.1"}}}, {"root", root}}.dump());
    support::WholeMesh mesh;
    LUMIGRID_ASSIGN_OR_RETURN(const auto file, mesh::streamMesh(folder_ / "tileset.json", mesh, {}));
    EXPECT_EQ(file.vertices, mesh.positions.size());
    Places places;
    for (std::size_t v = 0; v < mesh.positions.size(); v += 4)
      places.insert({mesh.positions[v].x, mesh.positions[v].y});
    EXPECT_EQ(4 * places.size(), mesh.positions.size()) << "no tile is read twice";
    return places;
  }
  std::string refusal(const json& root) const {
    const auto places = read(root);
    EXPECT_FALSE(places);
    return places ? "" : places.error().message;
  }

  const support::TemporaryDirectory folder_;
};

TEST_F(ImplicitTiles, theFinestReplaceTheCoarserAcrossSubtrees) {
  // Levels 0 and 1 lie in one subtree, level 2 below tile (1, 0) in another. Tile (0, 1) is a leaf; tile (0, 0) has no
  // content of its own, and (1, 1) is not there.
  //   tiles, Morton order: root | (0,0) (1,0) (0,1) (1,1)
  const Bits tiles{true, true, true, true, false};
  const Bits contents{true, false, true, true, false};
  Bits below(16, false);  // child subtrees are roots of level 2; (2, 0) … (3, 1) are the children of (1, 0)
  below[5] = true;        // (3, 0): x = 11, y = 00 in binary, interleaved 0101
  add("s/0.0.0.subtree", subtreeFile(availability(bitstream(0), bitstream(1), bitstream(2)), {tiles, contents, below}));
  add("s/2.3.0.subtree",
      subtreeFile(availability(bitstream(0), bitstream(0), constant(0)), {{true, false, false, false, false}}));
  for (const auto& [name, x, y] : {std::tuple{"c/0_0_0.glb", 90.0, 90.0},
                                   {"c/1_1_0.glb", 10.0, 0.0},
                                   {"c/1_0_1.glb", 0.0, 10.0},
                                   {"c/2_3_0.glb", 30.0, 0.0}})
    addSquare(name, x, y);
  const auto finest = read(quadtree("REPLACE", 4, 2));
  ASSERT_TRUE(finest) << finest.error().message;
  EXPECT_EQ(*finest, (Places{{0, 10}, {30, 0}}));
  const auto all = read(quadtree("ADD", 4, 2));
  ASSERT_TRUE(all) << all.error().message;
  EXPECT_EQ(*all, (Places{{90, 90}, {10, 0}, {0, 10}, {30, 0}}));
  // Without level 2 tile (1, 0) is the finest.
  EXPECT_EQ(*read(quadtree("REPLACE", 2, 2)), (Places{{10, 0}, {0, 10}}));
}

TEST_F(ImplicitTiles, octreesHaveAThirdCoordinate) {
  // One of eight children, (1, 0, 1): Morton index 5.
  add("s/0.0.0.0.subtree", subtreeFile(availability(constant(1), bitstream(0), constant(0)),
                                       {{false, false, false, false, false, false, true, false, false}}));
  addSquare("c/1_1_0_1.glb", 7, 8);
  json root = quadtree("REPLACE", 2, 2);
  root["content"]["uri"] = "c/{level}_{x}_{y}_{z}.glb";
  root["implicitTiling"]["subdivisionScheme"] = "OCTREE";
  root["implicitTiling"]["subtrees"]["uri"] = "s/{level}.{x}.{y}.{z}.subtree";
  const auto places = read(root);
  ASSERT_TRUE(places) << places.error().message;
  EXPECT_EQ(*places, (Places{{7, 8}}));
}

TEST_F(ImplicitTiles, theExtensionOfVersionOneAndOutsideBuffersAreRead) {
  json subtree = availability({{"bufferView", 0}}, {{"bufferView", 1}}, constant(0));
  subtree["contentAvailability"] = subtree["contentAvailability"][0];
  subtree["buffers"] = {{{"uri", "bits.bin"}, {"byteLength", 2}}};
  subtree["bufferViews"] = {{{"buffer", 0}, {"byteOffset", 0}, {"byteLength", 1}},
                            {{"buffer", 0}, {"byteOffset", 1}, {"byteLength", 1}}};
  add("s/0.0.0.subtree", subtree.dump());
  add("s/bits.bin", std::string("\x03\x02"));
  addSquare("c/1_0_0.glb", 1, 2);
  json root = quadtree("REPLACE", 2, 2);
  root["extensions"]["3DTILES_implicit_tiling"] = root["implicitTiling"];
  root.erase("implicitTiling");
  root["extensions"]["3DTILES_implicit_tiling"].erase("availableLevels");
  root["extensions"]["3DTILES_implicit_tiling"]["maximumLevel"] = 1;
  const auto places = read(root);
  ASSERT_TRUE(places) << places.error().message;
  EXPECT_EQ(*places, (Places{{1, 2}}));
}

TEST_F(ImplicitTiles, severalContentsHaveTheirOwnBits) {
  json subtree = availability(constant(1), constant(0), constant(0));
  subtree["contentAvailability"].push_back(constant(1));
  add("s/0.0.0.subtree", subtreeFile(subtree, {}));
  addSquare("d/0.glb", 3, 4);
  json root = quadtree("REPLACE", 1, 1);
  root.erase("content");
  root["contents"] = {{{"uri", "none/{level}.glb"}}, {{"uri", "d/{level}.glb"}}};
  const auto places = read(root);
  ASSERT_TRUE(places) << places.error().message;
  EXPECT_EQ(*places, (Places{{3, 4}}));
}

TEST_F(ImplicitTiles, brokenTreesAreOneClearLine) {
  const json root = quadtree("REPLACE", 2, 2);
  EXPECT_NE(refusal(root).find("s/0.0.0.subtree"), std::string::npos) << refusal(root);
  const auto with = [&root](const char* key, const json& value) {
    json other = root;
    other["implicitTiling"][key] = value;
    return other;
  };
  EXPECT_NE(refusal(with("subdivisionScheme", "BINARY")).find("the scheme \"BINARY\""), std::string::npos);
  EXPECT_NE(refusal(with("subtreeLevels", 21)).find("subtreeLevels that are not 1 to 20"), std::string::npos);
  EXPECT_NE(refusal(with("availableLevels", 63)).find("availableLevels that are not 1 to 62"), std::string::npos);
  EXPECT_NE(refusal(with("availableLevels", -1)).find("availableLevels that are not 1 to 62"), std::string::npos);
  EXPECT_NE(refusal(with("subtrees", 1)).find("no uri of its subtrees"), std::string::npos);
  // A name that is the same for several tiles would make millions of a few bytes.
  for (const char* uri : {"s/{level}.{x}.subtree", "s/a.subtree?{level}{x}{y}", "{level}/../{x}/../{y}/../a.subtree"})
    EXPECT_NE(refusal(with("subtrees", {{"uri", uri}})).find("gives several tiles one name"), std::string::npos) << uri;
  json same = root;
  same["content"]["uri"] = "c/{x}{y}.glb";
  EXPECT_NE(refusal(same).find("gives several tiles one name: \"c/{x}{y}.glb\""), std::string::npos);

  const Bits all(5, true);
  const std::string whole = subtreeFile(availability(bitstream(0), bitstream(0), constant(0)), {all});
  for (std::size_t length = 0; length < whole.size(); ++length) {
    add("s/0.0.0.subtree", whole.substr(0, length));
    const std::string message = refusal(root);
    EXPECT_NE(message.find("s/0.0.0.subtree: "), std::string::npos) << message;
  }
  add("s/0.0.0.subtree", whole);
  EXPECT_NE(refusal(root).find("c/1_0_0.glb"), std::string::npos) << "a content that is missing is named";
  EXPECT_NE(refusal(with("subtreeLevels", 3)).find("tileAvailability has 1 bytes, 21 bits are needed"),
            std::string::npos);
  add("s/0.0.0.subtree", subtreeFile(availability(bitstream(1), bitstream(0), constant(0)), {all}));
  EXPECT_NE(refusal(root).find("tileAvailability has neither a constant nor a bitstream that is there"),
            std::string::npos);
}

TEST_F(ImplicitTiles, endlessTreesEndWithALine) {
  // All tiles of 20 levels are there, 4 * 10^11 of them.
  add("s/0.0.0.subtree", subtreeFile(availability(constant(1), constant(0), constant(0)), {}));
  EXPECT_NE(refusal(quadtree("REPLACE", 62, 20)).find("it has more than 16777216 tiles"), std::string::npos);
  // A subtree that is not there is named.
  add("s/0.0.0.subtree", subtreeFile(availability(constant(1), constant(0), constant(1)), {}));
  EXPECT_NE(refusal(quadtree("REPLACE", 62, 2)).find("s/2.0.0.subtree"), std::string::npos);
}

}  // namespace
