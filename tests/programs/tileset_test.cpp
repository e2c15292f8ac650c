// A tileset becomes a scene that knows which way is up, also where that is no axis.
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "tests/programs/run_program.h"

namespace {

using nlohmann::json;
using programs::readText;
using programs::run;

class TilesetTest : public programs::ProgramTest {
 protected:
  /// A cube of 1 m, which tells no up by its shape, as one tile with this transform.
  std::string tileset(const json& transform) {
    std::string points;
    for (int v = 0; v < 8; ++v)
      for (int k = 0; k < 3; ++k) {
        const auto x = static_cast<float>(v >> k & 1);
        points.append(reinterpret_cast<const char*>(&x), sizeof(x));
      }
    const std::string indices("\0\2\3\0\3\1\4\5\7\4\7\6\0\1\5\0\5\4\2\6\7\2\7\3\0\4\6\0\6\2\1\3\7\1\7\5", 36);
    programs::writeText(path("cube.bin"), points + indices);
    const json model = {
        {"asset", {{"version", "2.0"}}},
        {"buffers", {{{"byteLength", 132}, {"uri", "cube.bin"}}}},
        {"bufferViews", {{{"buffer", 0}, {"byteLength", 96}}, {{"buffer", 0}, {"byteOffset", 96}, {"byteLength", 36}}}},
        {"accessors",
         {{{"bufferView", 0}, {"componentType", 5126}, {"count", 8}, {"type", "VEC3"}},
          {{"bufferView", 1}, {"componentType", 5121}, {"count", 36}, {"type", "SCALAR"}}}},
        {"meshes", {{{"primitives", {{{"attributes", {{"POSITION", 0}}}, {"indices", 1}}}}}}}};
    programs::writeText(path("cube.gltf"), model.dump());
    const json root = {{"refine", "REPLACE"},
                       {"geometricError", 0},
                       {"boundingVolume", {{"sphere", {0, 0, 0, 2}}}},
                       {"transform", transform},
                       {"content", {{"uri", "cube.gltf"}}}};
    programs::writeText(path("tileset.json"), json{{"asset", {{"version", "1.1"}}}, {"root", root}}.dump());
    return path("tileset.json");
  }
  json scene() const { return json::parse(readText(path("scene/scene.json"))); }
};

TEST_F(TilesetTest, localCoordinatesHaveZUp) {
  const std::string source = tileset({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 100, 200, 300, 1});
  const auto built = run("lumigrid", {"build", source, "-o", path("scene"), "--methods", "patch"});
  ASSERT_EQ(built.status, 0) << built.err;
  EXPECT_NE(built.err.find("up: z, since tilesets have it so"), std::string::npos) << built.err;
  EXPECT_EQ(scene()["up"], json({0.0, 0.0, 1.0}));
  EXPECT_EQ(scene()["units"], "m");
  EXPECT_EQ(scene()["box_min"], json({100.0, 199.0, 300.0}));
}

TEST_F(TilesetTest, geocentricCoordinatesHaveTheEarthsVertical) {
  // At 45° N and 0° E the vertical of the ellipsoid has equal parts along x and z.
  const double x = 4517590.8788, z = 4487348.4089;
  const std::string source = tileset({0, 1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 0, x, 0, z, 1});
  for (const char* const method : {"patch", "qsplat"}) {
    const auto built = run("lumigrid", {"build", source, "-o", path("scene"), "--methods", method, "--force"});
    ASSERT_EQ(built.status, 0) << built.err;
    EXPECT_EQ(scene()["crs"], "EPSG:4978");
    EXPECT_NEAR(scene()["up"][0], std::sqrt(0.5), 1e-6) << method;
    EXPECT_NEAR(scene()["up"][1], 0.0, 1e-6);
    EXPECT_NEAR(scene()["up"][2], std::sqrt(0.5), 1e-6);
  }
}

}  // namespace
