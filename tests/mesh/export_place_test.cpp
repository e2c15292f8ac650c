#include "mesh/export_place.h"

#include <filesystem>

#include "tests/mesh/mesh_files.h"

namespace mesh {
namespace {

std::string metadata(const std::string& system, const std::string& origin) {
  return "\xEF\xBB\xBF<?xml version=\"1.0\" encoding=\"utf-8\"?>\r\n<ModelMetadata version=\"1\">\r\n\t<SRS>" + system +
         "</SRS>\r\n\t<SRSOrigin>" + origin + "</SRSOrigin>\r\n\t<Texture><ColorSource>Visible</ColorSource>" +
         "</Texture>\r\n</ModelMetadata>\r\n";
}

ExportPlace placeOf(const std::string& xml) {
  const auto place = readExportPlace(xml);
  EXPECT_TRUE(place && *place) << xml;
  return place && *place ? **place : ExportPlace{};
}

TEST(ExportPlace, originAndSystemAreRead) {
  const ExportPlace place = placeOf(metadata("EPSG:32632", "691000,5334000.25,-520"));
  EXPECT_EQ(place.origin, glm::dvec3(691000.0, 5334000.25, -520.0));
  EXPECT_EQ(place.crs.code, "EPSG:32632");
  EXPECT_EQ(placeOf(metadata(" EPSG:25832+7837 ", " 1 ; 2e3, +3 ")).origin, glm::dvec3(1.0, 2000.0, 3.0));
  EXPECT_EQ(placeOf(metadata("EPSG:25832+7837", "1,2,3")).crs.code, "EPSG:25832+7837");
}

TEST(ExportPlace, wellKnownTextIsUnescaped) {
  const ExportPlace place =
      placeOf(metadata("PROJCS[&quot;WGS 84 / UTM zone 32N&quot;,UNIT[&quot;metre&quot;,1],AUTHORITY[&quot;EPSG&quot;,"
                       "&quot;32632&quot;]]",
                       "1,2,3"));
  EXPECT_EQ(place.crs.code, "EPSG:32632");
  EXPECT_EQ(place.crs.unit, "m");
}

TEST(ExportPlace, aLocalSystemHasNoCode) {
  for (const char* system : {"ENU:48.15,11.58", "", "EPSG:", "EPSG:32632x", "EPSG:+7", "none"})
    EXPECT_EQ(placeOf(metadata(system, "0,0,0")).crs.code, "") << system;
}

TEST(ExportPlace, otherXmlSaysNothing) {
  for (const char* xml :
       {"", "<Metadata><SRSOrigin>1,2,3</SRSOrigin></Metadata>", "<ModelMetadata><SRS>EPSG:32632</SRS></ModelMetadata>",
        "<ModelMetadata><SRSOrigin>1,2,3</ModelMetadata>",
        "<ModelMetadata><SRS>EPSG:4326</SRS><SRSOrigin>11.6,48.1,520</SRSOrigin></ModelMetadata>"}) {
    const auto place = readExportPlace(xml);
    ASSERT_TRUE(place) << xml;
    EXPECT_FALSE(*place) << xml;
  }
}

TEST(ExportPlace, anOriginThatIsNoneIsNamed) {
  for (const char* origin : {"", "1,2", "1,2,three", "1,2,nan", "1,2,inf", "1,2,3,4", "1,2,1e999", "--1,2,3"}) {
    const auto place = readExportPlace(metadata("EPSG:32632", origin));
    ASSERT_FALSE(place) << origin;
    EXPECT_NE(place.error().message.find("SRSOrigin is not three numbers"), std::string::npos);
  }
}

constexpr const char* kTriangle = "v 0.25 0 0\nv 1 0 0\nv 0 1 0.5\nf 1 2 3\n";

TEST(ExportPlace, tilesOfAnExportLieWhereItsFolderSays) {
  const std::string tile = mesh_files::directory() / "export/Data/Tile_+000_+000";
  std::filesystem::create_directories(tile);
  mesh_files::write("export/metadata.xml", metadata("EPSG:32632", "691000,5334000,520"));
  mesh_files::write("export/Data/metadata.xml", "<html></html>");
  support::WholeMesh obj;
  const auto read = streamMesh(mesh_files::write("export/Data/Tile_+000_+000/tile.obj", kTriangle), obj, {});
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(obj.positions.at(0), glm::dvec3(691000.25, 5334000.0, 520.0));
  EXPECT_EQ(obj.positions.at(2), glm::dvec3(691000.0, 5334001.0, 520.5));
  EXPECT_EQ(read->georeference.crs, "EPSG:32632");
  EXPECT_NE(read->georeference.moved.find("(691000, 5334000, 520)"), std::string::npos);

  // Colours above 1 make the reader start again.
  support::WholeMesh coloured;
  const auto again = streamMesh(mesh_files::write("export/Data/Tile_+000_+000/coloured.obj",
                                                  "v 0 0 0 0 1 1\nv 1 0 0 0 1 1\nv 0 1 0 200 7 7\nf 1 2 3\n"),
                                coloured, {});
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(coloured.positions.at(1), glm::dvec3(691001.0, 5334000.0, 520.0));
  EXPECT_EQ(coloured.colors.at(2), glm::u8vec4(200, 7, 7, 255));
  EXPECT_EQ(again->georeference.crs, "EPSG:32632");

  // Other formats tell themselves where they lie.
  const auto ply = support::readMesh(mesh_files::write(
      "export/Data/Tile_+000_+000/tile.ply",
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face "
      "1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"));
  ASSERT_TRUE(ply) << ply.error().message;
  EXPECT_EQ(ply->mesh.positions.at(0), glm::vec3(0.0F));

  mesh_files::write("export/Data/Tile_+000_+000/metadata.xml", metadata("EPSG:32632", "1,2"));
  const auto refused = support::readMesh(tile + "/tile.obj");
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("Tile_+000_+000/metadata.xml: SRSOrigin is not three numbers"),
            std::string::npos)
      << refused.error().message;
  std::filesystem::remove_all(mesh_files::directory() / "export");
}

}  // namespace
}  // namespace mesh
