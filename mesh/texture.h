#pragma once
// The textures of a mesh file: its pictures, and the colours that they give to triangles' corners, since hierarchies
// keep colours at vertices.
#include <algorithm>
#include <glm/glm.hpp>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"
#include "mesh/stream_mesh.h"

namespace mesh {

/// Decodes a JPEG (grey, RGB or CMYK; baseline or progressive), a PNG (8 or 16 bits, which become 8) or a WebP to 3
/// channels, or to 4 where it has an alpha. Errors: kInvalidInput (broken, or none of them), kUnsupported (a side over
/// 16384, or KTX).
base::Result<base::Image> decodePicture(base::ByteView bytes);
/// Reads and decodes a picture; errors name its file.
base::Result<base::Image> readPicture(const SourcePicture& picture);

/// A picture as a pyramid of images, each half as wide and high as the one before.
class Texture {
 public:
  /// Errors: those of decodePicture().
  static base::Result<Texture> decode(base::ByteView bytes);
  explicit Texture(base::Image picture);
  int width() const { return levels_[0].width; }
  int height() const { return levels_[0].height; }
  std::size_t bytes() const;
  /// The mean over about `texels` x `texels` texels around (u, v), where the picture is repeated. u runs to the right
  /// and v downwards, 0..1 across the picture. NaN gives grey.
  glm::u8vec4 mean(const glm::dvec2& uv, double texels) const;

 private:
  std::vector<base::Image> levels_;  // 3 channels
};

/// Bakes polygons, and measures how much finer the textures are than the mesh.
class TextureBaker {
 public:
  /// Gives each corner of a polygon the texture's mean over its share of the polygon.
  void bake(const Texture& texture, std::span<const glm::dvec2> uv, std::span<glm::u8vec4> colors);
  /// How many texels all polygons covered, those that several covered counted for each.
  double texels() const { return texels_; }

 private:
  double texels_ = 0.0;  // covered by all polygons so far
};

/// A warning for those who keep colours at vertices alone, where polygons cover clearly more texels than there are
/// vertices; else empty.
std::string lostTexels(double texels, std::uint64_t vertices);

/// The pictures of a mesh file, numbered in the order in which they were first used. Decoded ones are kept up to a
/// ceiling, so that hundreds of them take no more memory than a few.
class Textures {
 public:
  /// `path` is the mesh file's.
  explicit Textures(std::string path) : path_(std::move(path)) {}
  /// Where a file lies that the mesh file names: beside it, unless the name is a whole path. Windows programs write
  /// backslashes.
  std::string pathOf(const std::string& name) const;
  /// The mesh file itself, for pictures inside it.
  const std::string& path() const { return path_; }
  /// The number of a picture; kNoPicture where it cannot be read, for which `warnings` gets a line, for the
  /// first few.
  std::uint32_t find(const SourcePicture& picture, std::vector<std::string>& warnings);
  /// The picture of that number, decoded; valid until the next find().
  const Texture& operator[](std::uint32_t number) const { return *known_[number].decoded; }
  /// How many cannot be read beyond those that find() named.
  std::size_t unnamed() const { return unreadable_.size() - std::min(unreadable_.size(), kMaxNamed); }
  /// Those that could be read, by number.
  std::vector<SourcePicture> pictures() const;

 private:
  struct Known {
    SourcePicture picture;
    std::unique_ptr<Texture> decoded;  // null while it is not kept
    std::uint64_t used = 0;
  };
  static constexpr std::size_t kKeptBytes = std::size_t{256} << 20;  // a choice: three pictures of 4096 x 4096
  static constexpr std::size_t kMaxNamed = 8;  // a choice, since a set of tiles may have thousands
  void forgetOldest(const Known& but);

  std::string path_;
  std::vector<Known> known_;
  std::vector<SourcePicture> unreadable_;
  std::uint64_t uses_ = 0;
  std::uint32_t last_ = 0;  // the one found last, whose picture is kept
};

}  // namespace mesh
