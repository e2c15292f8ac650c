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
  const auto place = readMetadataXml(xml);
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
    const auto place = readMetadataXml(xml);
    ASSERT_TRUE(place) << xml;
    EXPECT_FALSE(*place) << xml;
  }
}

TEST(ExportPlace, anOriginThatIsNoneIsNamed) {
  for (const char* origin : {"", "1,2", "1,2,three", "1,2,nan", "1,2,inf", "1,2,3,4", "1,2,1e999", "--1,2,3"}) {
    const auto place = readMetadataXml(metadata("EPSG:32632", origin));
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

TEST(ExportPlace, offsetsOfPix4dAreRead) {
  const auto place = readOffsetXyz("\xEF\xBB\xBF 691000.000 5334000.250 -520.000\r\n",
                                   "PROJCS[\"WGS 84 / UTM zone 32N\",UNIT[\"metre\",1],AUTHORITY[\"EPSG\",\"32632\"]]");
  ASSERT_TRUE(place) << place.error().message;
  EXPECT_EQ(place->origin, glm::dvec3(691000.0, 5334000.25, -520.0));
  EXPECT_EQ(place->crs.code, "EPSG:32632");
  EXPECT_EQ(readOffsetXyz("1,2,3", "")->crs.code, "");
  for (const char* offset : {"", "1 2", "1 2 three", "1 2 3 4", "1 2 nan"}) EXPECT_FALSE(readOffsetXyz(offset, ""));
}

TEST(ExportPlace, coordinatesOfOpenDroneMapAreRead) {
  const auto codeOf = [](const std::string& system) {
    const auto place = readCoordsTxt(system + "\n691000 5334000\n-12.5 7.25 581.2\n");
    EXPECT_TRUE(place) << system;
    EXPECT_EQ(place->origin, glm::dvec3(691000.0, 5334000.0, 0.0)) << system;
    return place->crs.code;
  };
  EXPECT_EQ(codeOf("WGS84 UTM 32N"), "EPSG:32632");
  EXPECT_EQ(codeOf("WGS84 UTM 7S\r"), "EPSG:32707");
  EXPECT_EQ(codeOf("epsg:25832"), "EPSG:25832");
  EXPECT_EQ(codeOf("+proj=utm +zone=17 +south +datum=WGS84 +units=m +no_defs"), "EPSG:32717");
  EXPECT_EQ(codeOf("+proj=utm +ellps=WGS84 +zone=1"), "EPSG:32601");
  for (const char* system : {"", "WGS84 UTM 61N", "WGS84 UTM N", "WGS84 UTM 5", "+proj=utm +zone=32 +ellps=GRS80",
                             "+proj=tmerc +datum=WGS84 +zone=5", "+proj=utm +zone= +datum=WGS84"})
    EXPECT_EQ(codeOf(system), "") << system;
  for (const char* text : {"", "WGS84 UTM 32N", "WGS84 UTM 32N\n", "WGS84 UTM 32N\n1\n2", "WGS84 UTM 32N\none 2"})
    EXPECT_FALSE(readCoordsTxt(text)) << text;
}

/// Where a triangle lies that is written into this file of the export, and what is said of it.
struct Placed {
  glm::dvec3 first{0.0};
  Georeference georeference;
};
Placed placedAt(const std::string& file) {
  support::WholeMesh obj;
  const auto read = streamMesh(mesh_files::write(file, kTriangle), obj, {});
  EXPECT_TRUE(read) << read.error().message;
  return read ? Placed{obj.positions.at(0), read->georeference} : Placed{};
}

TEST(ExportPlace, projectsOfPix4dAndOpenDroneMapLieWhereTheySay) {
  const std::filesystem::path root = mesh_files::directory() / "";
  for (const char* folder : {"pix/2_densification/3d_mesh", "pix/1_initial/params", "odm/odm_texturing",
                             "odm/odm_georeferencing", "exports"})
    std::filesystem::create_directories(root / folder);
  mesh_files::write("pix/1_initial/params/site_offset.xyz", "691000 5334000 520\n");
  mesh_files::write("pix/1_initial/params/site_wkt.prj", "PROJCS[\"\",AUTHORITY[\"EPSG\",\"32632\"]]");
  const Placed pix = placedAt("pix/2_densification/3d_mesh/site_simplified_3d_mesh.obj");
  EXPECT_EQ(pix.first, glm::dvec3(691000.25, 5334000.0, 520.0));
  EXPECT_EQ(pix.georeference.crs, "EPSG:32632");
  EXPECT_NE(pix.georeference.moved.find("as site_offset.xyz says"), std::string::npos) << pix.georeference.moved;
  EXPECT_EQ(placedAt("pix/2_densification/3d_mesh/other.obj").first, glm::dvec3(0.25, 0.0, 0.0));

  // Where one folder has two projects the mesh's own counts, and a cloud of points is no offset.
  mesh_files::write("exports/a_offset.xyz", "1 2 3");
  mesh_files::write("exports/ab_offset.xyz", "10 20 30");
  mesh_files::write("exports/c_offset.xyz", std::string(300, '1'));
  EXPECT_EQ(placedAt("exports/ab.obj").first, glm::dvec3(10.25, 20.0, 30.0));
  EXPECT_EQ(placedAt("exports/a-mesh.obj").first, glm::dvec3(1.25, 2.0, 3.0));
  EXPECT_EQ(placedAt("exports/c.obj").first, glm::dvec3(0.25, 0.0, 0.0));
  mesh_files::write("exports/d_offset.xyz", "no numbers");
  const auto refused = support::readMesh(mesh_files::write("exports/d.obj", kTriangle));
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("exports/d_offset.xyz: it is not three numbers"), std::string::npos)
      << refused.error().message;

  mesh_files::write("odm/odm_georeferencing/coords.txt", "WGS84 UTM 32N\n691000 5334000\n1 2 3\n");
  const Placed odm = placedAt("odm/odm_texturing/odm_textured_model_geo.obj");
  EXPECT_EQ(odm.first, glm::dvec3(691000.25, 5334000.0, 0.0));
  EXPECT_EQ(odm.georeference.crs, "EPSG:32632");
  EXPECT_EQ(odm.georeference.units, "m");
  EXPECT_EQ(placedAt("odm/odm_texturing/odm_textured_model.obj").first, glm::dvec3(0.25, 0.0, 0.0));
  mesh_files::write("odm/odm_georeferencing/coords.txt", "EPSG:4326\n11.6 48.1\n");
  EXPECT_EQ(placedAt("odm/odm_texturing/odm_textured_model_geo.obj").first, glm::dvec3(0.25, 0.0, 0.0)) << "degrees";
  for (const char* folder : {"pix", "odm", "exports"}) std::filesystem::remove_all(root / folder);
}

}  // namespace
}  // namespace mesh
