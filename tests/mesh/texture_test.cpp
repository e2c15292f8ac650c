// Textures become colours of vertices, and the reader says what is lost.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <mutex>

#include "base/file.h"
#include "base/jpeg/jpeg.h"
#include "base/png/png.h"
#include "lod/patch/builder/hierarchy_build.h"
#include "lod/patch/format.h"
#include "mesh/stream_mesh.h"
#include "mesh/texture.h"
#include "tests/mesh/mesh_files.h"

namespace {

// A folder that holds a picture. Its left half is red, its right half blue, and the top rows of both are green.
class Textures : public testing::Test {
 protected:
  void SetUp() override {
    base::Image image(64, 64, 3);
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 64; ++x) {
        image.at(x, y)[0] = y >= 16 && x < 32 ? 255 : 0;
        image.at(x, y)[1] = y < 16 ? 255 : 0;
        image.at(x, y)[2] = y >= 16 && x >= 32 ? 255 : 0;
      }
    ASSERT_TRUE(base::writePng(image, folder / "picture.png"));
  }

  base::Result<support::MeshFile> read(const std::string& name, const std::string& text) {
    std::ofstream(folder / name, std::ios::binary) << text;
    return support::readMesh(folder / name);
  }

  const support::TemporaryDirectory folder;
};

glm::u8vec4 colorAt(const support::MeshFile& mesh, const glm::vec3& p) {
  for (std::size_t v = 0; v < mesh.mesh.positions.size(); ++v)
    if (mesh.mesh.positions[v] == p) return mesh.mesh.colors[v];
  ADD_FAILURE() << "no vertex there";
  return {};
}

// Returns a strip of three quads, textured from left to right. v is 0.25 below and 0.3 above, so within the red and
// blue rows.
std::string objStrip(const std::string& library) {
  std::string text = "mtllib " + library + "\nusemtl skin\n";
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 2; ++j)
      text += "v " + std::to_string(i) + " " + std::to_string(j) + " 0\nvt " + std::to_string(0.05 + 0.3 * i) + " " +
              (j == 0 ? "0.25" : "0.3") + "\n";
  for (int i = 0; i < 3; ++i) {
    const auto corner = [&](int k) { return std::to_string(k) + "/" + std::to_string(k) + " "; };
    text += "f " + corner(2 * i + 1) + corner(2 * i + 3) + corner(2 * i + 4) + corner(2 * i + 2) + "\n";
  }
  return text;
}

TEST_F(Textures, objTexturesColorTheVertices) {
  std::ofstream(folder / "skin.mtl") << "newmtl other\nKd 1 1 1\nnewmtl skin\nmap_Kd -s 1 1 1 picture.png\n";
  const auto mesh = read("strip.obj", objStrip("skin.mtl"));
  ASSERT_TRUE(mesh) << mesh.error().message;
  EXPECT_EQ(colorAt(*mesh, {0, 0, 0}), glm::u8vec4(255, 0, 0, 255));
  EXPECT_EQ(colorAt(*mesh, {3, 0, 0}), glm::u8vec4(0, 0, 255, 255));
  EXPECT_TRUE(mesh->file.warnings.empty());
  EXPECT_NEAR(mesh->file.texels, 57.6 * 3.2, 1e-3);
  ASSERT_EQ(mesh->file.pictures.size(), 1U);
  EXPECT_EQ(mesh->file.pictures[0].path, folder / "picture.png");
}

// Names of materials, libraries and pictures have spaces; pictures are named as on the disk of who made them.
TEST_F(Textures, objNamesAreFoundWithSpacesInAnotherCaseAndFromOtherDisks) {
  std::filesystem::rename(folder / "picture.png", folder / "my picture.png");
  std::filesystem::create_directory(folder / "parts");
  const std::string names[] = {"my picture.png", "-s 1 1 1 -o 0.5 -bm 2 -clamp on my picture.png", "MY Picture.PNG",
                               "C:\\scans\\may\\My picture.png", "/nowhere/my picture.png"};
  for (const std::string& name : names) {
    std::ofstream(folder / "my skin.mtl") << "newmtl skin of glass\nnewmtl skin\nmap_Kd " << name << "\n";
    const auto mesh = read("strip.obj", objStrip("my skin.mtl"));
    ASSERT_TRUE(mesh) << mesh.error().message;
    EXPECT_TRUE(mesh->file.warnings.empty()) << name << ": " << mesh->file.warnings.front();
    EXPECT_EQ(colorAt(*mesh, {3, 0, 0}), glm::u8vec4(0, 0, 255, 255)) << name;
  }
}

// Plans of buildings and machines have materials without pictures.
TEST_F(Textures, objMaterialsColorTheirFaces) {
  const std::string squares =
      "mtllib paint.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 5 0 0\nv 6 0 0\nv 6 1 0\nv 5 1 0\n"
      "usemtl dark red\nf 1 2 3 4\nusemtl plain\nf 5 6 7 8\n";
  std::ofstream(folder / "paint.mtl") << "newmtl dark red\nKd 0.5 0 0\nnewmtl plain\nKd 0.8 0.8 2\n";
  const auto mesh = read("squares.obj", squares);
  ASSERT_TRUE(mesh) << mesh.error().message;
  EXPECT_EQ(colorAt(*mesh, {1, 1, 0}), glm::u8vec4(128, 0, 0, 255));
  EXPECT_EQ(colorAt(*mesh, {5, 1, 0}), glm::u8vec4(204, 204, 255, 255));

  // One grey is what exporters give a scan that has no colours.
  std::ofstream(folder / "paint.mtl") << "newmtl dark red\nKd 0.8 0.8 0.8\nnewmtl plain\nKd spectral a.rfl\n";
  const auto grey = read("squares.obj", squares);
  ASSERT_TRUE(grey) << grey.error().message;
  EXPECT_TRUE(grey->mesh.colors.empty());

  // Scanned colours say more than a material.
  std::ofstream(folder / "paint.mtl") << "newmtl dark red\nKd 0.5 0 0\n";
  std::string scanned = squares;
  for (std::size_t at = 0; (at = scanned.find(" 0\nv", at)) != std::string::npos; at += 8)
    scanned.replace(at, 2, " 0 0 1 0");
  const auto own = read("squares.obj", scanned);
  ASSERT_TRUE(own) << own.error().message;
  EXPECT_EQ(colorAt(*own, {1, 0, 0}), glm::u8vec4(0, 255, 0, 255));
}

TEST_F(Textures, objTexturesReachTheHierarchy) {
  std::ofstream(folder / "skin.mtl") << "newmtl skin\nmap_Kd picture.png\n";
  std::ofstream(folder / "strip.obj") << objStrip("skin.mtl");
  const std::string out = folder / "patch.lgp";
  const auto summary = lod::patch::builder::buildHierarchyFromFiles({folder / "strip.obj"}, {}, out);
  ASSERT_TRUE(summary) << summary.error().message;
  // 57.6 x 3.2 texels come to 8 vertices, which one line says.
  ASSERT_EQ(summary->warnings.size(), 1U);
  EXPECT_NE(summary->warnings[0].find("23.0 texels for every vertex"), std::string::npos) << summary->warnings[0];
  const auto file = lod::patch::PatchFile::open(out);
  ASSERT_TRUE(file) << file.error().message;
  const auto geometry = file->geometry(0);
  ASSERT_TRUE(geometry);
  for (std::size_t v = 0; v < geometry->positions.size(); ++v) {
    const float x = file->hierarchy().lattice.position(geometry->positions[v]).x;
    if (x < 0.5F) {
      EXPECT_GT(geometry->colors[v].r, 245);
    } else if (x > 2.5F) {
      EXPECT_GT(geometry->colors[v].b, 245);
    }
  }
}

TEST_F(Textures, thatAreMissingWarnAndTheMeshStays) {
  std::ofstream(folder / "skin.mtl") << "newmtl skin\nmap_Kd nowhere.png\n";
  const auto mesh = read("strip.obj", objStrip("skin.mtl"));
  ASSERT_TRUE(mesh) << mesh.error().message;
  EXPECT_TRUE(mesh->mesh.colors.empty());
  ASSERT_EQ(mesh->file.warnings.size(), 1U);
  EXPECT_NE(mesh->file.warnings[0].find("nowhere.png"), std::string::npos);

  std::ofstream(folder / "picture.png") << "no picture at all";
  std::ofstream(folder / "skin.mtl") << "newmtl skin\nmap_Kd picture.png\n";
  const auto broken = read("strip.obj", objStrip("skin.mtl"));
  ASSERT_TRUE(broken) << broken.error().message;
  EXPECT_TRUE(broken->mesh.colors.empty());
  EXPECT_EQ(broken->file.warnings.size(), 1U);
}

TEST_F(Textures, thatAreMissingByTheHundredAreNotAllNamed) {
  std::ofstream library(folder / "skin.mtl");
  std::string text = "mtllib skin.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n";
  for (int i = 0; i < 100; ++i) {
    library << "newmtl m" << i << "\nmap_Kd nowhere" << i << ".png\n";
    text += "usemtl m" + std::to_string(i) + "\nf 1/1 2/1 3/1\n";
  }
  library.close();
  const auto mesh = read("many.obj", text);
  ASSERT_TRUE(mesh) << mesh.error().message;
  ASSERT_EQ(mesh->file.warnings.size(), 9U);
  EXPECT_EQ(mesh->file.warnings.back(), "92 more textures cannot be read");
}

TEST_F(Textures, plyFaceCoordinatesColorTheVertices) {
  const auto mesh = read(
      "quad.ply",
      "ply\nformat ascii 1.0\ncomment TextureFile picture.png\nelement vertex 4\nproperty float x\nproperty float y\n"
      "property float z\nelement face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n"
      "end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
      "3 0 1 2 6 0.1 0.1 0.9 0.1 0.9 0.2\n3 0 2 3 6 0.1 0.1 0.9 0.2 0.1 0.2\n");
  ASSERT_TRUE(mesh) << mesh.error().message;
  ASSERT_FALSE(mesh->mesh.colors.empty());
  EXPECT_GT(colorAt(*mesh, {0, 1, 0}).r, 200);
  EXPECT_GT(colorAt(*mesh, {1, 0, 0}).b, 150);
  EXPECT_EQ(colorAt(*mesh, {0, 1, 0}).g, 0);
}

// A photograph's share of details of all sizes, as a JPEG whose units can be told.
base::Bytes naturalJpeg(int side) {
  base::Image image(side, side, 3);
  std::uint32_t random = 7;
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x)
      for (int k = 0; k < 3; ++k) {
        random = random * 1664525 + 1013904223;
        const double wave = 30 * std::sin(0.011 * x + k) + 25 * std::cos(0.05 * y - 0.03 * x) + 15 * std::sin(0.4 * x);
        image.at(x, y)[k] = static_cast<std::uint8_t>(128 + wave + static_cast<double>(random >> 28));
      }
  base::Bytes jpeg;
  EXPECT_TRUE((*base::beginJpeg(side, side, 90, base::Subsampling::k420, jpeg))->add(image));
  return jpeg;
}

// The exact mean of a picture over each corner's share of a triangle, whose corners are in texels.
std::array<glm::dvec3, 3> exactMeans(const base::Image& image, const std::array<glm::dvec2, 3>& corners) {
  std::array<glm::dvec3, 3> sums{};
  std::array<int, 3> counts{};
  const glm::dvec2 u = corners[1] - corners[0], v = corners[2] - corners[0];
  const double twice = u.x * v.y - u.y * v.x;
  for (int y = 0; y < 4 * image.height; ++y)
    for (int x = 0; x < 4 * image.width; ++x) {
      const glm::dvec2 p = glm::dvec2(x + 0.5, y + 0.5) / 4.0 - corners[0];
      const double b = (p.x * v.y - p.y * v.x) / twice, c = (u.x * p.y - u.y * p.x) / twice, a = 1.0 - b - c;
      if (std::min({a, b, c}) < 0.0) continue;
      // The nearest corner's share is where its coordinate is the largest.
      const std::size_t k = a >= b && a >= c ? 0 : b >= c ? 1 : 2;
      const std::uint8_t* texel = image.at(x / 4, y / 4);
      sums[k] += glm::dvec3(texel[0], texel[1], texel[2]);
      ++counts[k];
    }
  for (std::size_t k = 0; k < 3; ++k) sums[k] /= counts[k];
  return sums;
}

TEST_F(Textures, giveTheExactMeansFromAQuarterOfTheirSizeToo) {
  const base::Bytes jpeg = naturalJpeg(256);
  const auto whole = base::decodeJpeg(jpeg);
  ASSERT_TRUE(whole);
  const glm::ivec2 size(256, 256);
  for (const double leg : {29.0, 45.0, 80.0}) {  // triangles of 420, 1012 and 3200 texels
    double squares = 0.0;
    for (int i = 0; i < 6; ++i) {
      const glm::dvec2 at(20.0 + 24.3 * i, 150.0 - 21.7 * i), along = leg * glm::dvec2(std::cos(i), std::sin(i));
      const std::array<glm::dvec2, 3> corners{at + 40.0, at + 40.0 + along, at + 40.0 + glm::dvec2(-along.y, along.x)};
      std::array<glm::dvec2, 3> uv{};
      for (std::size_t k = 0; k < 3; ++k) uv[k] = corners[k] / glm::dvec2(size);
      ASSERT_EQ(mesh::TextureBaker::levelFor(size, uv), 2);
      const auto quarter = mesh::Texture::decode(jpeg, 2);
      ASSERT_TRUE(quarter);
      std::array<glm::u8vec4, 3> colors{};
      mesh::TextureBaker().bake(*quarter, uv, colors);
      const auto exact = exactMeans(*whole, corners);
      for (std::size_t k = 0; k < 3; ++k) {
        const glm::dvec3 off = glm::dvec3(glm::u8vec3(colors[k])) - exact[k];
        squares += glm::dot(off, off) / (3.0 * 18.0);
      }
    }
    EXPECT_LT(std::sqrt(squares), 2.5) << leg;
  }
}

TEST_F(Textures, areTheSameInEachRepetition) {
  const auto texture = mesh::Texture::decode(naturalJpeg(256));
  ASSERT_TRUE(texture);
  // Near the edges pictures begin again, and those elsewhere do not.
  for (const double x : {0.001, 0.03, 0.4, 0.95, 0.99}) {
    const std::array<glm::dvec2, 3> uv{glm::dvec2(x, 0.3), {x + 0.04, 0.31}, {x + 0.01, 0.36}};
    std::array<glm::u8vec4, 3> colors{}, moved_colors{};
    mesh::TextureBaker().bake(*texture, uv, colors);
    for (const glm::dvec2& shift : {glm::dvec2(1, 0), {-1, 2}, {0, -3}, {1000, 1000}}) {
      std::array<glm::dvec2, 3> moved = uv;
      for (glm::dvec2& corner : moved) corner += shift;
      mesh::TextureBaker().bake(*texture, moved, moved_colors);
      for (std::size_t k = 0; k < 3; ++k)
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(colors[k][c], moved_colors[k][c], 1) << x << ' ' << shift.x;
    }
  }
}

// Returns a sheet of cells x cells x 2 triangles over the whole of each picture, one beside the other.
std::string texturedSheets(int pictures, int cells) {
  std::string text = "mtllib sheets.mtl\n";
  const auto number = [](double value) { return std::to_string(value) + " "; };
  for (int p = 0; p < pictures; ++p)
    for (int j = 0; j <= cells; ++j)
      for (int i = 0; i <= cells; ++i) {
        const double u = static_cast<double>(i) / cells, v = static_cast<double>(j) / cells;
        text += "v " + number(p + u) + number(v) + "0\nvt " + number(u) + number(v) + "\n";
      }
  for (int p = 0; p < pictures; ++p) {
    text += "usemtl m" + std::to_string(p) + "\n";
    for (int j = 0; j < cells; ++j)
      for (int i = 0; i < cells; ++i) {
        const auto corner = [&](int x, int y) {
          const std::string n = std::to_string(1 + (p * (cells + 1) + j + y) * (cells + 1) + i + x);
          return n + "/" + n + " ";
        };
        text += "f " + corner(0, 0) + corner(1, 0) + corner(1, 1) + "\nf " + corner(0, 0) + corner(1, 1) +
                corner(0, 1) + "\n";
      }
  }
  return text;
}

TEST_F(Textures, areDecodedOnceAsFineAsTheirTrianglesNeed) {
  constexpr int kPictures = 3;
  const base::Bytes jpeg = naturalJpeg(256);
  std::ofstream library(folder / "sheets.mtl");
  for (int p = 0; p < kPictures; ++p) {
    ASSERT_TRUE(base::writeFileAtomically(folder / ("p" + std::to_string(p) + ".jpg"), jpeg));
    library << "newmtl m" << p << "\nmap_Kd p" << p << ".jpg\n";
  }
  library.close();
  // Units are told where a picture is decoded at a quarter of its size: all of those of large triangles, none of those
  // of small ones.
  for (const auto& [cells, quarters] : {std::pair(4, kPictures), std::pair(24, 0)}) {
    std::ofstream(folder / "sheets.obj") << texturedSheets(kPictures, cells);
    std::mutex mutex;
    int told = 0;
    mesh::StreamOptions options;
    options.keep_units = [&](const mesh::SourcePicture&, base::ByteView) {
      const std::lock_guard lock(mutex);
      ++told;
    };
    support::WholeMesh ignored;
    ASSERT_TRUE(mesh::streamMesh(folder / "sheets.obj", ignored, options));
    EXPECT_EQ(told, quarters) << cells;
  }
}

TEST_F(Textures, areAveragedOverEachVertexShareOfItsPolygons) {
  // Red and blue texels in turn, but for black ones beyond the triangle: no corner may take a single texel's colour,
  // nor any of those that lie outside.
  base::Image image(64, 64, 3);
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 64; ++x)
      if (x + (63 - y) <= 65) image.at(x, y)[(x + y) % 2 == 0 ? 0 : 2] = 255;
  ASSERT_TRUE(base::writePng(image, folder / "picture.png"));
  std::ofstream(folder / "skin.mtl") << "newmtl skin\nmap_Kd picture.png\n";
  const auto mesh = read("one.obj",
                         "mtllib skin.mtl\nusemtl skin\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
                         "f 1/1 2/2 3/3\n");
  ASSERT_TRUE(mesh) << mesh.error().message;
  for (const glm::u8vec4& c : mesh->mesh.colors) {
    EXPECT_NEAR(c.r, 128, 12);
    EXPECT_NEAR(c.b, 128, 12);
    EXPECT_GT(c.r + c.b, 235);
  }
}

}  // namespace
