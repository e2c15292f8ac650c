// Generated scans with textures hold what their header promises: sizes, charts, lettering and colours.
#include "mesh/generate/textured.h"

#include <cmath>
#include <filesystem>
#include <numbers>
#include <sstream>

#include "base/crc32c.h"
#include "base/file.h"
#include "mesh/generate/atlas.h"
#include "mesh/generate/font.h"
#include "mesh/texture.h"
#include "tests/mesh/mesh_files.h"

namespace {

using namespace mesh::generate;
using mesh_files::Mesh;

constexpr std::array<TexturedShape, 3> kShapes{TexturedShape::kFacade, TexturedShape::kTerrain, TexturedShape::kRooms};

TexturedOptions options(TexturedShape shape, std::uint64_t triangles, std::uint64_t texels, std::uint64_t seed = 1) {
  TexturedOptions o;
  o.shape = shape;
  o.triangles = triangles;
  o.texels = texels;
  o.seed = seed;
  return o;
}

/// The files of one scan, read without the project's reader.
struct Scan {
  struct Triangle {
    std::array<glm::dvec3, 3> corners;
    std::array<glm::dvec2, 3> uv;  // v runs downwards
    std::size_t picture;
  };
  std::vector<Triangle> triangles;
  std::vector<std::string> materials;  // in the order of their usemtl lines
  std::vector<mesh::Texture> pictures;
  std::size_t unknown = 0;  // lines of other kinds than are expected

  double texelsOf(const Triangle& t) const {
    const glm::dvec2 size(pictures[t.picture].width(), pictures[t.picture].height());
    const glm::dvec2 a = size * (t.uv[1] - t.uv[0]), b = size * (t.uv[2] - t.uv[0]);
    return 0.5 * std::abs(a.x * b.y - a.y * b.x);
  }
  glm::dvec3 at(const Triangle& t, const glm::dvec3& weights) const {
    const glm::dvec2 uv = weights.x * t.uv[0] + weights.y * t.uv[1] + weights.z * t.uv[2];
    return glm::dvec3(pictures[t.picture].mean(uv, 1.0));
  }
};

Scan readScan(const std::string& path) {
  Scan scan;
  std::vector<glm::dvec3> positions;
  std::vector<glm::dvec2> uv;
  const auto bytes = base::readFile(path);
  if (!bytes) return scan;
  std::istringstream lines(std::string(bytes->begin(), bytes->end()));
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string keyword;
    words >> keyword;
    if (keyword == "v") {
      glm::dvec3 p;
      words >> p.x >> p.y >> p.z;
      positions.push_back(p);
    } else if (keyword == "vt") {
      glm::dvec2 p;
      words >> p.x >> p.y;
      uv.emplace_back(p.x, 1.0 - p.y);
    } else if (keyword == "usemtl") {
      std::string material;
      words >> material;
      scan.materials.push_back(material);
    } else if (keyword == "f") {
      Scan::Triangle t;
      for (std::size_t k = 0; k < 3; ++k) {
        std::size_t vertex = 0, texture = 0;
        char slash = 0;
        words >> vertex >> slash >> texture;
        t.corners[k] = positions.at(vertex - 1);
        t.uv[k] = uv.at(texture - 1);
      }
      t.picture = scan.materials.size() - 1;
      scan.triangles.push_back(t);
    } else if (keyword != "#" && keyword != "mtllib") {
      ++scan.unknown;
    }
  }
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  for (const std::string& material : scan.materials)
    if (const auto jpeg = base::readFile((folder / (material + ".jpg")).string()))
      if (auto picture = mesh::Texture::decode(*jpeg)) scan.pictures.push_back(std::move(*picture));
  return scan;
}

class Textured : public testing::Test {
 protected:
  std::string write(const TexturedOptions& o, const std::string& name = "scan.obj") {
    const std::string path = folder / name;
    const auto written = writeTexturedObj(o, path);
    EXPECT_TRUE(written) << (written ? "" : written.error().message);
    return path;
  }
  Scan make(const TexturedOptions& o) { return readScan(write(o)); }

  const support::TemporaryDirectory folder;
};

TEST_F(Textured, hasTheTrianglesAskedForWithinTwoPercent) {
  for (std::uint64_t wanted = 128; wanted < 200'000; wanted += 1 + wanted / 37) {
    const double facade = static_cast<double>(makeFacade(wanted, 1)->triangleCount());
    EXPECT_NEAR(facade / static_cast<double>(wanted), 1.0, 0.02) << wanted;
    const std::uint64_t furnished = std::max(wanted, kMinRoomsTriangles);
    const double rooms = static_cast<double>(makeRooms(furnished, 1)->triangleCount());
    EXPECT_NEAR(rooms / static_cast<double>(furnished), 1.0, 0.02) << furnished;
    if (wanted % 5 != 0) continue;  // it takes longer
    const double terrain = static_cast<double>(makeTerrain(wanted, 1)->triangleCount());
    EXPECT_NEAR(terrain / static_cast<double>(wanted), 1.0, 0.02) << wanted;
  }
}

TEST_F(Textured, fileHasTheTrianglesOfTheSurface) {
  EXPECT_EQ(make(options(TexturedShape::kFacade, 5'000, 20)).triangles.size(), makeFacade(5'000, 1)->triangleCount());
  EXPECT_EQ(make(options(TexturedShape::kTerrain, 5'000, 20)).triangles.size(), makeTerrain(5'000, 1)->triangleCount());
  EXPECT_EQ(make(options(TexturedShape::kRooms, 5'000, 20)).triangles.size(), makeRooms(5'000, 1)->triangleCount());
}

TEST_F(Textured, readerHasNothingToWarnOf) {
  for (const TexturedShape shape : kShapes) {
    const auto read = support::readMesh(write(options(shape, 3'000, 200)));
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_TRUE(read->file.warnings.empty()) << read->file.warnings[0];
    EXPECT_GE(read->file.texels, 0.98 * 200.0 * 3'000.0);
    EXPECT_NEAR(static_cast<double>(read->mesh.triangleCount()), 3'000.0, 60.0);
  }
}

TEST_F(Textured, trianglesCoverTheTexelsAskedFor) {
  for (const TexturedShape shape : kShapes) {
    const Scan scan = make(options(shape, 2'000, 700));
    ASSERT_EQ(scan.pictures.size(), scan.materials.size());
    double texels = 0.0;
    for (const Scan::Triangle& t : scan.triangles) texels += scan.texelsOf(t);
    const double mean = texels / static_cast<double>(scan.triangles.size());
    EXPECT_GE(mean, 700.0 * (1.0 - 1e-4));  // as texture coordinates are rounded
    EXPECT_LE(mean, 702.0);
  }
}

TEST_F(Textured, textureCoordinatesLieInsideThePictures) {
  for (const TexturedShape shape : kShapes)
    for (const Scan::Triangle& t : make(options(shape, 1'000, 50)).triangles)
      for (const glm::dvec2& uv : t.uv) {
        ASSERT_GE(std::min(uv.x, uv.y), 0.0);
        ASSERT_LE(std::max(uv.x, uv.y), 1.0);
      }
}

TEST_F(Textured, eachMaterialIsUsedOnceAndInOrder) {
  // 18 million texels are more than a picture holds, and the terrain has four tiles at least.
  const Scan facade = make(options(TexturedShape::kFacade, 1'000, 18'000));
  ASSERT_GE(facade.materials.size(), 2U);
  const Scan terrain = make(options(TexturedShape::kTerrain, 200, 50));
  ASSERT_EQ(terrain.materials.size(), 4U);
  for (const Scan* scan : {&facade, &terrain}) {
    EXPECT_EQ(scan->unknown, 0U);
    EXPECT_EQ(scan->pictures.size(), scan->materials.size());
    for (std::size_t i = 0; i < scan->materials.size(); ++i) EXPECT_EQ(scan->materials[i], "scan_" + std::to_string(i));
    for (const mesh::Texture& picture : scan->pictures)
      EXPECT_LE(std::max(picture.width(), picture.height()), kMaxPictureSide);
  }
}

TEST_F(Textured, facadeIsOnePieceWithoutHoles) {
  for (const std::uint64_t triangles : {128U, 3'000U, 6'000U}) {
    const auto read = support::readMesh(write(options(TexturedShape::kFacade, triangles, 10)));
    ASSERT_TRUE(read) << read.error().message;
    const Mesh& mesh = read->mesh;
    const auto onRim = [&](std::uint32_t v) {
      const glm::dvec3 p = mesh.origin + glm::dvec3(mesh.positions[v]);
      return std::min({p.x, 20.0 - p.x, p.y, 12.0 - p.y}) < 1e-5;
    };
    const auto edges = mesh_files::directedEdges(mesh);
    for (const auto& [edge, count] : edges) {
      ASSERT_EQ(count, 1);
      ASSERT_TRUE(edges.contains({edge.second, edge.first}) || (onRim(edge.first) && onRim(edge.second)));
    }
  }
}

TEST_F(Textured, chartsLieApartAndAreTurnedAndMirrored) {
  const auto surface = makeFacade(20'000, 1);
  const auto atlas = makeAtlas(*surface, 500);
  ASSERT_TRUE(atlas);
  std::set<std::pair<bool, bool>> poses;
  for (std::size_t i = 0; i < atlas->charts.size(); ++i) {
    const Chart& a = atlas->charts[i];
    poses.insert({a.turned, a.mirrored});
    const glm::ivec2 end = a.place + atlas->extent(a);
    const int gap = atlas->style.gap;
    EXPECT_TRUE(glm::all(glm::greaterThanEqual(a.place, glm::ivec2(gap))));
    EXPECT_TRUE(glm::all(glm::lessThanEqual(end + gap, atlas->pictures[a.picture])));
    for (std::size_t k = 0; k < i; ++k) {
      const Chart& b = atlas->charts[k];
      const glm::ivec2 apart = glm::max(a.place - b.place - atlas->extent(b), b.place - end);
      EXPECT_TRUE(a.picture != b.picture || std::max(apart.x, apart.y) >= gap) << i << " and " << k;
    }
    const glm::dvec2 st = a.low + glm::dvec2(0.25, 0.75) * a.size;
    EXPECT_LT(glm::distance(atlas->sheetFromPicture(a, atlas->pictureFromSheet(a, st)), st), 1e-9);
  }
  EXPECT_EQ(poses.size(), 4U);
}

TEST_F(Textured, blackLiesBetweenChartsOfTheFacadeOnly) {
  const auto shareOfBlack = [&](TexturedShape shape) {
    const Scan scan = make(options(shape, 2'000, 400));
    std::size_t black = 0, all = 0;
    for (const mesh::Texture& picture : scan.pictures)
      for (int y = 0; y < picture.height(); y += 3)
        for (int x = 0; x < picture.width(); x += 3) {
          const glm::dvec2 uv = (glm::dvec2(x, y) + 0.5) / glm::dvec2(picture.width(), picture.height());
          black += glm::dot(glm::dvec3(picture.mean(uv, 1.0)), glm::dvec3(1.0)) < 9.0 ? 1 : 0;
          ++all;
        }
    return static_cast<double>(black) / static_cast<double>(all);
  };
  EXPECT_GT(shareOfBlack(TexturedShape::kFacade), 0.05);
  EXPECT_LT(shareOfBlack(TexturedShape::kTerrain), 0.001);
}

/// Finds triangles by the place that they cover of the plane of x and y.
class TriangleFinder {
 public:
  explicit TriangleFinder(const Scan& scan) : scan_(scan) {
    for (std::size_t i = 0; i < scan.triangles.size(); ++i) {
      const auto& c = scan.triangles[i].corners;
      const glm::dvec2 low = glm::min(glm::min(glm::dvec2(c[0]), glm::dvec2(c[1])), glm::dvec2(c[2]));
      const glm::dvec2 high = glm::max(glm::max(glm::dvec2(c[0]), glm::dvec2(c[1])), glm::dvec2(c[2]));
      for (int y = static_cast<int>(low.y); y <= static_cast<int>(high.y); ++y)
        for (int x = static_cast<int>(low.x); x <= static_cast<int>(high.x); ++x) cells_[{x, y}].push_back(i);
    }
  }
  /// The triangle over a point, with the point's weights; null where none is.
  const Scan::Triangle* find(const glm::dvec2& p, glm::dvec3& weights) const {
    const auto cell = cells_.find({static_cast<int>(p.x), static_cast<int>(p.y)});
    if (cell == cells_.end()) return nullptr;
    for (const std::size_t i : cell->second) {
      const Scan::Triangle& t = scan_.triangles[i];
      const glm::dvec2 a(t.corners[0]), ab = glm::dvec2(t.corners[1]) - a, ac = glm::dvec2(t.corners[2]) - a;
      const double area = ab.x * ac.y - ab.y * ac.x;
      if (std::abs(area) < 1e-9) continue;
      const glm::dvec2 d = p - a;
      weights.y = (d.x * ac.y - d.y * ac.x) / area;
      weights.z = (ab.x * d.y - ab.y * d.x) / area;
      weights.x = 1.0 - weights.y - weights.z;
      if (std::min({weights.x, weights.y, weights.z}) >= -1e-9) return &t;
    }
    return nullptr;
  }

 private:
  const Scan& scan_;
  std::map<std::pair<int, int>, std::vector<std::size_t>> cells_;
};

// Every cell of a letter that is at least four texels wide is looked up in the picture, through the mesh.
TEST_F(Textured, picturesShowTheLettersOfTheSigns) {
  for (const auto& [shape, side] :
       {std::pair(TexturedShape::kFacade, 250.0), std::pair(TexturedShape::kTerrain, 40'000.0)}) {
    const Scan scan = make(options(shape, 20'000, 500, 5));
    const TriangleFinder finder(scan);
    const double texel = std::sqrt(side / (20'000.0 * 500.0));
    std::set<double> heights;
    for (const Sign& sign : signsOf(shape, 5)) {
      const double cell = sign.height / kGlyphRows;
      if (cell < 4.0 * texel) continue;
      heights.insert(sign.height);
      int ink = 0, wrong = 0;
      for (int i = 0; i < static_cast<int>(sign.text.size()); ++i)
        for (int row = 0; row < kGlyphRows; ++row)
          for (int column = 0; column < kGlyphAdvance; ++column) {
            const glm::dvec3 p = sign.corner + cell * ((kGlyphAdvance * i + column + 0.5) * sign.right +
                                                       (kGlyphRows - row - 0.5) * sign.up);
            glm::dvec3 weights(0.0);
            const Scan::Triangle* t = finder.find(glm::dvec2(p), weights);
            ASSERT_NE(t, nullptr);
            const bool is_ink = isInk(sign.text[static_cast<std::size_t>(i)], column, row);
            const double light = glm::dot(scan.at(*t, weights), glm::dvec3(1.0 / 3.0));
            ink += is_ink ? 1 : 0;
            wrong += is_ink ? light > 100.0 : light < 170.0;
          }
      EXPECT_GT(ink, 0) << sign.text;
      EXPECT_EQ(wrong, 0) << sign.text;
    }
    EXPECT_GE(heights.size(), 4U);
  }
}

TEST_F(Textured, signsLieOnTheSurface) {
  // Metres: a triangle of the facade is 0.17 wide, one of the terrain 2, and both are even beneath signs.
  for (const auto& [shape, tolerance] :
       {std::pair(TexturedShape::kFacade, 0.01), std::pair(TexturedShape::kTerrain, 0.05)}) {
    const Scan scan = make(options(shape, 20'000, 5, 2));
    const TriangleFinder finder(scan);
    for (const Sign& sign : signsOf(shape, 2))
      for (const double along : {0.0, 0.5, 1.0}) {
        const double width = along * textWidth(sign.text) * sign.height / kGlyphRows;
        const glm::dvec3 p = sign.corner + width * sign.right + 0.5 * sign.height * sign.up;
        glm::dvec3 weights(0.0);
        const Scan::Triangle* t = finder.find(glm::dvec2(p), weights);
        ASSERT_NE(t, nullptr);
        const double z = weights.x * t->corners[0].z + weights.y * t->corners[1].z + weights.z * t->corners[2].z;
        EXPECT_NEAR(z, p.z, tolerance) << sign.text;
      }
  }
}

// Nobody sees the outside of a flat that was scanned from inside: from any place in a room all that is met is met at
// its front, and the surface is closed but for the backs of the furniture, which meets the floor.
TEST_F(Textured, roomsFaceWhoStandsInThem) {
  const auto rooms = makeRooms(6'000, 3);
  const glm::dvec3 eye(2.3, 2.0, 1.5);
  double solid_angle = 0.0;
  const auto corner = [&](std::uint32_t sheet, std::uint32_t i, std::uint32_t j) {
    return rooms->position(rooms->vertexAt(sheet, i, j)) - eye;
  };
  const auto angleOf = [](const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c) {
    const double la = glm::length(a), lb = glm::length(b), lc = glm::length(c);
    return 2.0 * std::atan2(glm::dot(a, glm::cross(b, c)),
                            la * lb * lc + glm::dot(a, b) * lc + glm::dot(b, c) * la + glm::dot(c, a) * lb);
  };
  for (std::uint32_t sheet = 0; sheet < rooms->sheets().size(); ++sheet)
    for (std::uint32_t j = 0; j < rooms->sheets()[sheet].rows(); ++j)
      for (std::uint32_t i = 0; i < rooms->sheets()[sheet].columns(); ++i) {
        const glm::dvec3 a = corner(sheet, i, j), b = corner(sheet, i + 1, j), c = corner(sheet, i + 1, j + 1),
                         d = corner(sheet, i, j + 1);
        solid_angle += angleOf(a, b, c) + angleOf(a, c, d);
      }
  EXPECT_NEAR(solid_angle / (4.0 * std::numbers::pi), -1.0, 0.03);  // furniture has no lower side
}

// Each cell of a letter is looked up in the paint where its sign says that it is.
TEST_F(Textured, signsOfRoomsAreOnTheirWalls) {
  const auto paint = makePaint(TexturedShape::kRooms, 5);
  ASSERT_GT(paint->signs().size(), 40U);
  for (const Sign& sign : paint->signs()) {
    const double cell = sign.height / kGlyphRows;
    int wrong = 0;
    for (int i = 0; i < static_cast<int>(sign.text.size()); ++i)
      for (int row = 0; row < kGlyphRows; ++row)
        for (int column = 0; column < kGlyphAdvance; ++column) {
          const glm::dvec3 p = sign.corner + cell * ((kGlyphAdvance * i + column + 0.5) * sign.right +
                                                     (kGlyphRows - row - 0.5) * sign.up);
          const double light = glm::dot(paint->colorAt(p, 0.25 * cell), glm::dvec3(1.0 / 3.0));
          wrong += isInk(sign.text[static_cast<std::size_t>(i)], column, row) ? light > 100.0 : light < 150.0;
        }
    EXPECT_EQ(wrong, 0) << sign.text;
  }
}

TEST_F(Textured, paintGivesTheColoursOfThePictures) {
  for (const TexturedShape shape : kShapes) {
    const Scan scan = make(options(shape, 6'000, 500, 3));
    const auto paint = makePaint(shape, 3);
    double sum = 0.0;
    std::size_t far = 0;
    for (const Scan::Triangle& t : scan.triangles) {
      const glm::dvec3 middle = (t.corners[0] + t.corners[1] + t.corners[2]) / 3.0;
      const double area = 0.5 * glm::length(glm::cross(t.corners[1] - t.corners[0], t.corners[2] - t.corners[0]));
      const glm::dvec3 truth = paint->colorAt(middle, std::sqrt(area / scan.texelsOf(t)));
      const double off = glm::length(scan.at(t, glm::dvec3(1.0 / 3.0)) - truth) / std::sqrt(3.0);
      sum += off;
      far += off > 40.0 ? 1 : 0;
    }
    // The rest is JPEG's loss at quality 92, and steep triangles whose texels are no squares.
    EXPECT_LT(sum / static_cast<double>(scan.triangles.size()), 6.0);
    EXPECT_LT(far, scan.triangles.size() / 100);
  }
}

TEST_F(Textured, isDeterminedByItsSeedAlone) {
  for (const TexturedShape shape : kShapes) {
    const auto bytes = [&](std::uint64_t seed, const std::string& end) {
      write(options(shape, 1'000, 30, seed));
      return base::readFile(folder / ("scan" + end)).value();
    };
    EXPECT_EQ(bytes(1, ".obj"), bytes(1, ".obj"));
    EXPECT_EQ(bytes(1, "_0.jpg"), bytes(1, "_0.jpg"));
    EXPECT_NE(bytes(1, ".obj"), bytes(2, ".obj"));
    EXPECT_NE(bytes(1, "_0.jpg"), bytes(2, "_0.jpg"));
  }
}

// One small mesh of each shape must have these bytes on every machine and with every compiler.
TEST_F(Textured, bytesOfTheMeshAreTheSameOnEveryMachine) {
  const std::array<std::pair<TexturedShape, std::uint32_t>, 3> golden{{{TexturedShape::kFacade, 0xD43272A3U},
                                                                       {TexturedShape::kTerrain, 0x9214D3F0U},
                                                                       {TexturedShape::kRooms, 0x3A277C06U}}};
  for (const auto& [shape, crc] : golden) {
    const auto bytes = base::readFile(write(options(shape, 6'000, 4, 42)));
    ASSERT_TRUE(bytes);
    EXPECT_EQ(base::crc32c(*bytes), crc);
  }
}

TEST_F(Textured, originIsAddedToEveryPosition) {
  for (const TexturedShape shape : kShapes) {
    TexturedOptions o = options(shape, 600, 4);
    const Scan plain = make(o);
    o.origin = {1e6, -1e6, 250.0};
    const Scan moved = make(o);
    ASSERT_EQ(moved.triangles.size(), plain.triangles.size());
    for (std::size_t i = 0; i < plain.triangles.size(); ++i)
      for (std::size_t k = 0; k < 3; ++k) {
        ASSERT_LT(glm::distance(moved.triangles[i].corners[k], plain.triangles[i].corners[k] + o.origin), 2e-5);
        ASSERT_EQ(moved.triangles[i].uv[k], plain.triangles[i].uv[k]);
      }
  }
}

TEST_F(Textured, filesAreThoseNamedBefore) {
  for (const TexturedShape shape : kShapes) {
    const TexturedOptions o = options(shape, 700, 100);
    std::filesystem::create_directory(folder / "one");
    const auto names = texturedFiles(o, folder / "one/scan.obj");
    ASSERT_TRUE(names);
    write(o, "one/scan.obj");
    std::set<std::string> there;
    for (const auto& entry : std::filesystem::directory_iterator(folder / "one")) there.insert(entry.path().string());
    EXPECT_EQ(there, std::set<std::string>(names->begin(), names->end()));
    std::filesystem::remove_all(folder / "one");
  }
}

TEST_F(Textured, wrongOptionsAndStopsLeaveNoFile) {
  const std::string path = folder / "never.obj";
  const auto refused = [&](const TexturedOptions& o, const std::string& to) {
    const auto written = writeTexturedObj(o, to);
    return !written && written.error().code == base::ErrorCode::kInvalidInput;
  };
  const TexturedShape shape = TexturedShape::kFacade;
  EXPECT_TRUE(refused(options(shape, 127, 10), path));
  EXPECT_TRUE(refused(options(TexturedShape::kRooms, 499, 10), path));
  EXPECT_TRUE(refused(options(shape, 100'000'001, 10), path));
  EXPECT_TRUE(refused(options(shape, 1'000, 0), path));
  EXPECT_TRUE(refused(options(shape, 1'000, 100'001), path));
  EXPECT_TRUE(refused(options(shape, 100'000'000, 100'000), path));  // 600 000 pictures
  EXPECT_TRUE(refused(options(shape, 1'000, 10), folder / "never.ply"));
  EXPECT_TRUE(refused(options(shape, 1'000, 10), folder / "not ever.obj"));
  for (const double last : {0.0, 0.5, 0.95}) {
    const auto stopped = writeTexturedObj(options(shape, 20'000, 10), path, [&](double done) { return done < last; });
    ASSERT_FALSE(stopped);
    EXPECT_EQ(stopped.error().code, base::ErrorCode::kCancelled);
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder / ""));
}

}  // namespace
