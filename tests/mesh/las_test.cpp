// LAS files give the points, colours and coordinate reference system that were written; what lies is named.
#include <limits>

#include "tests/mesh/mesh_files.h"
#include "tests/support/las_file.h"

namespace {

using namespace mesh_files;
using support::LasFile;
using support::LasPoint;
using support::patch;

base::Result<Cloud> readLas(const std::string& bytes, const std::string& name = "cloud.las") {
  return readCloud(bytes, name);
}

std::string cloudError(const std::string& bytes, const std::string& name = "cloud.las") {
  const auto read = readLas(bytes, name);
  EXPECT_FALSE(read) << "it was read";
  return read ? "" : read.error().message;
}

/// Three points with colours of 16 bits.
LasFile threePoints() {
  LasFile file;
  file.points = {{{0, 0, 0}, {65535, 0, 0x1234}, 100},
                 {{1000, -2000, 3}, {0, 65535, 0}, 300},
                 {{2147483647, -2147483647 - 1, 7}, {256, 512, 1024}, 200}};
  return file;
}

// ---- Points

TEST(LasReader, readsAllFormatsOfAllVersions) {
  for (int minor = 0; minor <= 4; ++minor)
    for (int format = 0; format <= (minor < 4 ? 5 : 10); ++format) {
      LasFile file = threePoints();
      file.minor = minor, file.format = format, file.padding = 5;
      const auto cloud = readLas(bytesOf(file));
      ASSERT_TRUE(cloud) << cloud.error().message;
      ASSERT_EQ(cloud->positions.size(), 3U) << minor << " " << format;
      EXPECT_EQ(cloud->positions[1], glm::dvec3(1.0, -2.0, 0.003));
      ASSERT_EQ(cloud->colors.size(), 3U);
      const bool colored = support::kLasColor[static_cast<std::size_t>(format)] != 0;
      EXPECT_EQ(cloud->colors[0], colored ? glm::u8vec4(255, 0, 0x12, 255) : glm::u8vec4(0, 0, 0, 255));
      EXPECT_EQ(cloud->colors[1], colored ? glm::u8vec4(0, 255, 0, 255) : glm::u8vec4(255));
      EXPECT_EQ(cloud->colors[2], colored ? glm::u8vec4(1, 2, 4, 255) : glm::u8vec4(188, 188, 188, 255));
    }
}

TEST(LasReader, positionsKeepTheScaleFarFromTheOrigin) {
  LasFile file = threePoints();
  file.scale = {0.001, 0.0001, 0.01};
  file.offset = {1e6, 4e6, -1e6};
  const auto cloud = readLas(bytesOf(file));
  ASSERT_TRUE(cloud) << cloud.error().message;
  for (std::size_t i = 0; i < 3; ++i)
    for (int axis = 0; axis < 3; ++axis) {
      const auto k = static_cast<std::size_t>(axis);
      const double exact = file.scale[k] * file.points[i].number[k] + file.offset[k];
      EXPECT_LT(std::abs(cloud->positions[i][axis] - exact), 1e-9) << i << " " << axis;
      // Two neighbouring numbers stay apart by the scale.
      const double next = file.scale[k] * (file.points[i].number[k] - 1.0) + file.offset[k];
      EXPECT_NEAR(cloud->positions[i][axis] - next, file.scale[k], 1e-9);
    }
}

TEST(LasReader, colorsOfEightBitsAreToldByTheirValues) {
  LasFile file = threePoints();
  file.points[0].color = {255, 0, 17}, file.points[1].color = {1, 2, 3}, file.points[2].color = {0, 0, 0};
  const auto cloud = readLas(bytesOf(file));
  ASSERT_TRUE(cloud);
  EXPECT_EQ(cloud->colors[0], glm::u8vec4(255, 0, 17, 255));
  EXPECT_EQ(cloud->colors[1], glm::u8vec4(1, 2, 3, 255));
  EXPECT_TRUE(cloud->file.warnings.empty());
}

/// So many points that the sample, a quarter of them at most, leaves gaps, with a colour in the first gap.
LasFile manyPoints(const glm::u16vec3& usual, const glm::u16vec3& in_gap) {
  LasFile file;
  constexpr std::size_t kPoints = std::size_t{1} << 18;
  file.points.resize(kPoints);
  for (std::size_t i = 0; i < kPoints; ++i) {
    file.points[i].number = {static_cast<std::int32_t>(i), 0, 0};
    file.points[i].color = {usual.r, usual.g, usual.b};
    file.points[i].intensity = static_cast<std::uint16_t>(i % 100);
  }
  file.points[kPoints - 2].color = {in_gap.r, in_gap.g, in_gap.b};
  return file;
}

TEST(LasReader, oneLateColorOfSixteenBitsMakesAllOfThemSo) {
  const auto cloud = readLas(bytesOf(manyPoints({200, 100, 0}, {0xFFFF, 0, 0x100})));
  ASSERT_TRUE(cloud);
  ASSERT_EQ(cloud->colors.size(), std::size_t{1} << 18);
  EXPECT_EQ(cloud->colors.front(), glm::u8vec4(0, 0, 0, 255));
  EXPECT_EQ(cloud->colors[cloud->colors.size() - 2], glm::u8vec4(255, 0, 1, 255));
  EXPECT_EQ(cloud->file.vertices, std::uint64_t{1} << 18);
}

TEST(LasReader, oneLateColorAmongBlackOnesMeansThatThereAreColors) {
  const auto cloud = readLas(bytesOf(manyPoints({0, 0, 0}, {7, 8, 9})));
  ASSERT_TRUE(cloud);
  EXPECT_EQ(cloud->colors[50], glm::u8vec4(0, 0, 0, 255));
  EXPECT_EQ(cloud->colors[cloud->colors.size() - 2], glm::u8vec4(7, 8, 9, 255));
  EXPECT_TRUE(cloud->file.warnings.empty());
}

TEST(LasReader, withoutColorsIntensitiesBecomeGreyAndAreSaidSo) {
  for (const int format : {6, 7}) {  // format 7 with black colours has none
    LasFile file = threePoints();
    file.format = format;
    for (LasPoint& point : file.points) point.color = {};
    const auto cloud = readLas(bytesOf(file));
    ASSERT_TRUE(cloud);
    ASSERT_EQ(cloud->file.warnings.size(), 1U);
    EXPECT_EQ(cloud->file.warnings[0], "it has no colours; intensities from 100 to 300 are shown from black to white");
    EXPECT_EQ(cloud->colors[2], glm::u8vec4(188, 188, 188, 255)) << "half of the light, in sRGB";
  }
}

TEST(LasReader, aFewBrightReflectorsDoNotDarkenTheRest) {
  LasFile file = manyPoints({0, 0, 0}, {0, 0, 0});
  file.points[5].intensity = 65535;
  const auto cloud = readLas(bytesOf(file));
  ASSERT_TRUE(cloud);
  EXPECT_EQ(cloud->colors[5], glm::u8vec4(255));
  EXPECT_GT(cloud->colors[90].r, 200);
  EXPECT_LT(cloud->colors[10].r, 100);
}

TEST(LasReader, equalIntensitiesAreNoColors) {
  LasFile file = threePoints();
  file.format = 6;
  for (LasPoint& point : file.points) point.intensity = 500;
  const auto cloud = readLas(bytesOf(file));
  ASSERT_TRUE(cloud);
  EXPECT_FALSE(cloud->file.has_colors);
  EXPECT_TRUE(cloud->colors.empty());
  EXPECT_TRUE(cloud->file.warnings.empty());
}

TEST(LasReader, withheldPointsAndNoiseStayOutAndAreCounted) {
  for (const int format : {3, 7}) {
    LasFile file = threePoints();
    file.format = format;
    for (const int classification : {7, 18, 7}) {
      file.points.push_back(file.points[0]);
      file.points.back().classification = classification;
    }
    file.points.insert(file.points.begin(), file.points[1]);
    file.points.front().is_withheld = true;
    const auto cloud = readLas(bytesOf(file));
    ASSERT_TRUE(cloud);
    EXPECT_EQ(cloud->positions.size(), 3U);
    EXPECT_EQ(cloud->file.vertices, 3U);
    EXPECT_EQ(cloud->colors.size(), 3U);
    ASSERT_EQ(cloud->file.warnings.size(), 1U);
    EXPECT_EQ(cloud->file.warnings[0],
              "its points are read without 1 that are marked as withheld and 3 of noise (classes 7 and 18)");
  }
}

TEST(LasReader, aFileOfNoiseAloneIsAnError) {
  LasFile file = threePoints();
  for (LasPoint& point : file.points) point.classification = 7;
  EXPECT_TRUE(contains(cloudError(bytesOf(file)), "all of its 3 points are marked as withheld or as noise"));
}

TEST(LasReader, readingTellsProgressAndCanBeCancelled) {
  LasFile file = manyPoints({0, 0, 0}, {0, 0, 0});
  for (LasPoint& point : file.points) point.is_withheld = &point != &file.points.back();
  const std::string path = write("long.las", bytesOf(file));
  support::WholeMesh whole;
  mesh::StreamOptions options;
  options.accepts_points = true;
  options.progress = [](double) { return false; };
  const auto read = mesh::streamMesh(path, whole, options);
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().code, base::ErrorCode::kCancelled);
}

// ---- Coordinate reference systems

const std::string kUtm =
    R"(COMPD_CS["NAD83 / UTM 12N + NAVD88",PROJCS["NAD83 / UTM zone 12N",GEOGCS["NAD83",DATUM["North_American_Datum",)"
    R"(SPHEROID["GRS 1980",6378137,298.257,AUTHORITY["EPSG","7019"]],AUTHORITY["EPSG","6269"]],PRIMEM["Greenwich",0],)"
    R"(UNIT["degree",0.0174532925199433],AUTHORITY["EPSG","4269"]],PROJECTION["Transverse_Mercator"],)"
    R"(UNIT["metre",1,AUTHORITY["EPSG","9001"]],AXIS["Easting",EAST],AUTHORITY["EPSG","26912"]],)"
    R"(VERT_CS["NAVD88 height",UNIT["metre",1],AUTHORITY["EPSG","5703"]]])";

mesh::StreamedFile readWith(const std::string& well_known_text, bool extended = false) {
  LasFile file = threePoints();
  auto& records = extended ? file.extended_records : file.records;
  records.emplace_back(2111, "unknown");
  records.emplace_back(2112, well_known_text + '\0');
  auto cloud = readLas(bytesOf(file));
  EXPECT_TRUE(cloud) << cloud.error().message;
  return cloud ? cloud->file : mesh::StreamedFile();
}

TEST(LasReader, takesCodeAndUnitOfTheHorizontalSystem) {
  for (const bool extended : {false, true}) {
    const mesh::StreamedFile file = readWith(kUtm, extended);
    EXPECT_EQ(file.georeference.crs, "EPSG:26912");
    EXPECT_EQ(file.georeference.units, "m");
    EXPECT_EQ(file.georeference.up, mesh::Georeference::Up::kZ);
    EXPECT_TRUE(file.warnings.empty());
  }
  // The newer form names units in axes, and codes as numbers.
  const mesh::StreamedFile newer = readWith(
      R"(PROJCRS["NAD83(2011) / Iowa zone 1",BASEGEOGCRS["NAD83",ID["EPSG",6318]],CONVERSION["x",ID["EPSG",1]],)"
      R"(CS[Cartesian,2],AXIS["e",east,LENGTHUNIT["US survey foot",0.304800609601219]],ID["EPSG",8713]])");
  EXPECT_EQ(newer.georeference.crs, "EPSG:8713");
  EXPECT_EQ(newer.georeference.units, "us-ft");
  ASSERT_EQ(newer.warnings.size(), 1U);
  EXPECT_EQ(newer.warnings[0], "its coordinates are in US survey feet, and so is the scene");
}

TEST(LasReader, aSystemWithoutCodeIsToldByItsName) {
  const mesh::StreamedFile file =
      readWith(R"(PROJCS["NAD_1983_StatePlane_Feet",GEOGCS["GCS",UNIT["Degree",0.017]],UNIT["Foot",0.3048]])");
  EXPECT_EQ(file.georeference.crs, "");
  EXPECT_EQ(file.georeference.units, "ft");
  ASSERT_EQ(file.warnings.size(), 2U);
  EXPECT_TRUE(contains(file.warnings[0], "its coordinate reference system is \"NAD_1983_StatePlane_Feet\""));
  EXPECT_TRUE(contains(file.warnings[1], "feet of 0.3048 m"));
}

TEST(LasReader, degreesAreWarnedOf) {
  const mesh::StreamedFile file =
      readWith(R"(GEOGCS["WGS 84",UNIT["degree",0.0174532925199433],AUTHORITY["EPSG","4326"]])");
  EXPECT_EQ(file.georeference.crs, "EPSG:4326");
  EXPECT_EQ(file.georeference.units, "");
  ASSERT_EQ(file.warnings.size(), 1U);
  EXPECT_TRUE(contains(file.warnings[0], "x and y are degrees"));
}

std::string geoKeys(const std::vector<std::array<std::uint16_t, 4>>& keys) {
  std::string bytes;
  put(bytes, std::array<std::uint16_t, 4>{1, 1, 0, static_cast<std::uint16_t>(keys.size())});
  for (const auto& key : keys) put(bytes, key);
  return bytes;
}

TEST(LasReader, geoTiffKeysTellTheSystemToo) {
  LasFile file = threePoints();
  file.minor = 2, file.format = 3;
  file.records = {{34735, geoKeys({{1024, 0, 1, 1}, {3072, 0, 1, 2992}, {3076, 0, 1, 9002}})}};
  auto cloud = readLas(bytesOf(file));
  ASSERT_TRUE(cloud);
  EXPECT_EQ(cloud->file.georeference.crs, "EPSG:2992");
  EXPECT_EQ(cloud->file.georeference.units, "ft");

  file.records = {{34735, geoKeys({{3072, 0, 1, 32767}, {3073, 34737, 9, 4}})}, {34737, "any|My grid|"}};
  cloud = readLas(bytesOf(file));
  ASSERT_TRUE(cloud);
  EXPECT_EQ(cloud->file.georeference.crs, "");
  ASSERT_EQ(cloud->file.warnings.size(), 1U);
  EXPECT_TRUE(contains(cloud->file.warnings[0], "\"My grid\" without a code"));
}

TEST(LasReader, brokenRecordsCostTheSystemAndNotThePoints) {
  LasFile file = threePoints();
  file.records = {{2112, kUtm}};
  std::string bytes = bytesOf(file);
  patch(bytes, 375 + 20, std::uint16_t{65535});  // its length
  const auto cloud = readLas(bytes);
  ASSERT_TRUE(cloud) << cloud.error().message;
  EXPECT_EQ(cloud->positions.size(), 3U);
  EXPECT_EQ(cloud->file.georeference.crs, "");
  ASSERT_EQ(cloud->file.warnings.size(), 1U);
  EXPECT_TRUE(contains(cloud->file.warnings[0], "1 of the records beside its points cannot be read"));
}

// ---- Refusals

TEST(LasReader, headersThatLieAreNamed) {
  const std::string whole = bytesOf(threePoints());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto with = [&whole](std::size_t at, auto value) {
    std::string bytes = whole;
    patch(bytes, at, value);
    return bytes;
  };
  const struct {
    std::string bytes, message;
  } cases[] = {
      {with(25, std::uint8_t{5}), "LAS 1.5 is not read (1.0 to 1.4 are)"},
      {with(24, std::uint8_t{2}), "LAS 2.4 is not read"},
      {with(94, std::uint16_t{227}), "header: it says that it has 227 bytes; 375 are the least"},
      {with(96, std::uint32_t{374}), "header: points begin at byte 374, inside the header of 375"},
      {with(96, std::uint32_t{4000000}), "before the points, which begin at 4000000; get the whole file again"},
      {with(104, std::uint8_t{11}), "points of format 11 are not read (0 to 10 are)"},
      {with(105, std::uint16_t{35}), "points have 35 bytes; those of format 7 have 36 at least; export"},
      {with(105, std::uint16_t{0}), "points have 0 bytes"},
      {with(107, std::uint32_t{4}), "header: it counts 3 points in 64 bits and 4 in 32; export the file again"},
      {with(247, std::uint64_t{4}), "truncated: the file ends in point 3 of 4; get the whole file again"},
      {with(247, ~std::uint64_t{0}), "truncated: the file ends in point 3 of 18446744073709551615"},
      {with(247, std::uint64_t{0}), "the file has no points"},
      {with(139, 0.0), "header: the scale of y is 0; export the file again"},
      {with(131, nan), "header: the scale of x is not finite"},
      {with(171, nan), "header: the offset of z is not finite"},
      {"LASF", "truncated: the file ends in the header"},
  };
  for (const auto& c : cases) {
    const std::string message = cloudError(c.bytes);
    EXPECT_TRUE(contains(message, c.message)) << "got:    " << message << "\nwanted: " << c.message;
    EXPECT_TRUE(contains(message, "cloud.las: "));
    EXPECT_EQ(message.find('\n'), std::string::npos);
  }
  EXPECT_TRUE(contains(cloudError("hello"), "not a LAS file: it does not begin with \"LASF\""));
}

TEST(LasReader, oneOfTheTwoCountsIsEnough) {
  LasFile file = threePoints();
  file.format = 3;
  std::string bytes = bytesOf(file);
  patch(bytes, 247, std::uint64_t{0});
  EXPECT_TRUE(readLas(bytes));
  bytes = bytesOf(file);
  patch(bytes, 107, std::uint32_t{0});
  EXPECT_TRUE(readLas(bytes));
}

TEST(LasReader, contentDecidesOverTheName) {
  EXPECT_TRUE(readLas(bytesOf(threePoints()), "cloud.laz"));
  EXPECT_TRUE(readLas(bytesOf(threePoints()), "cloud.ply"));
}

TEST(LasReader, withoutSplatsACloudGetsTheAdviceOfAPly) {
  const std::string message = errorOf("a.las", bytesOf(threePoints()));
  EXPECT_TRUE(contains(
      message, "the file has no faces (a point cloud?); mesh it first, or build it with --methods qsplat or pmr"))
      << message;
}

TEST(ConvertedFormats, areRefusedWithTheCommandThatConvertsThem) {
  std::string laz = bytesOf(threePoints());
  laz[104] = static_cast<char>(0x80 | 7);
  std::string old_laz = laz;
  old_laz[104] = 0x40 | 3;
  LasFile with_record = threePoints();
  with_record.records = {{22204, "x"}};
  std::string laz_by_record = bytesOf(with_record);
  laz_by_record.replace(375 + 2, 16, std::string("laszip encoded\0\0", 16));
  const struct {
    std::string name, bytes, command;
  } cases[] = {
      {"a.laz", laz, "pdal translate in.laz out.las"},
      {"a.las", old_laz, "pdal translate in.laz out.las"},
      {"a.las", laz_by_record, "pdal translate in.laz out.las"},
      {"a.bin", "ASTM-E57 and more", "pdal translate in.e57 out.las"},
      {"a.E57", "anything", "pdal translate in.e57 out.las"},
      {"a.bin", std::string("Kaydara FBX Binary  \0", 21), "assimp export in.fbx out.glb"},
      {"a.fbx", "; FBX 7.7.0 project file", "assimp export in.fbx out.glb"},
  };
  for (const auto& c : cases)
    for (const bool accepts_points : {false, true}) {
      const std::string message = accepts_points ? cloudError(c.bytes, c.name) : errorOf(c.name, c.bytes);
      EXPECT_TRUE(contains(message, c.command)) << message;
      EXPECT_TRUE(contains(message, "is not read; convert it")) << message;
    }
}

/// Every kind of record and of point in one small file.
std::string fullFile() {
  LasFile file = threePoints();
  file.records = {{2112, kUtm}, {34735, geoKeys({{3072, 0, 1, 32612}})}, {34737, "name|"}};
  file.extended_records = {{2112, kUtm}};
  file.points[1].classification = 7;
  return bytesOf(file);
}

TEST(LasReader, filesCutAtEveryLengthNeverCrash) {
  LasFile plain = threePoints();
  const std::string without_records = bytesOf(plain);
  for (std::size_t length = 1; length < without_records.size(); ++length)
    EXPECT_FALSE(readLas(without_records.substr(0, length))) << length;

  // Behind the points a cut costs the records that are there, and is told.
  const std::string whole = fullFile();
  const std::size_t end_of_points = whole.size() - 60 - kUtm.size();
  for (std::size_t length = 1; length < whole.size(); ++length) {
    const auto read = readLas(whole.substr(0, length));
    ASSERT_EQ(static_cast<bool>(read), length >= end_of_points) << length;
    if (read) {
      EXPECT_TRUE(contains(read->file.warnings.front(), "cannot be read"));
    }
  }
}

TEST(LasReader, filesWithAnyByteChangedNeverCrash) {
  const std::string whole = fullFile();
  for (std::size_t at = 0; at < whole.size(); ++at)
    for (const char value : {'\0', '\1', '\xff', '[', '"'}) {
      std::string broken = whole;
      broken[at] = value;
      const auto read = readLas(broken);
      if (!read) {
        EXPECT_EQ(read.error().message.find('\n'), std::string::npos);
      }
    }
}

}  // namespace
