#pragma once
// The textures of a mesh file: its pictures, and the colours that they give to triangles' corners, since hierarchies
// keep colours at vertices.
#include <algorithm>
#include <array>
#include <deque>
#include <future>
#include <glm/glm.hpp>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/file.h"
#include "base/image.h"
#include "mesh/stream_mesh.h"

namespace mesh {

/// Decodes a JPEG (grey, RGB or CMYK; baseline or progressive), a PNG (8 or 16 bits, which become 8) or a WebP to 3
/// channels, or to 4 where it has an alpha. Pixels whose alpha is 0 get the colours of those near them that are seen,
/// so that no mean and no edge takes on what stands there unseen. `opaque`: to 3 in any case, each pixel as it is.
/// Errors: kInvalidInput (broken, or none of them), kUnsupported (a side over 16384, or KTX).
base::Result<base::Image> decodePicture(base::ByteView bytes, bool opaque = false);
/// A picture's bytes as its file has them, decoded from base64 where they are text.
class PictureBytes {
 public:
  /// Errors: those of opening the file; kInvalidInput where it ends before the picture, or the text is broken.
  static base::Result<PictureBytes> open(const SourcePicture& picture);
  base::ByteView view() const { return decoded_ ? base::ByteView(*decoded_) : view_; }

 private:
  explicit PictureBytes(base::MappedFile file) : file_(std::move(file)) {}
  base::MappedFile file_;
  base::ByteView view_;
  std::optional<base::Bytes> decoded_;
};
/// The size that a picture's header says, texels. Errors: those of decodePicture().
base::Result<glm::ivec2> pictureSize(base::ByteView bytes);
/// Reads and decodes a picture; errors name its file.
base::Result<base::Image> readPicture(const SourcePicture& picture);

/// A picture as a pyramid of images, each half as wide and high as the one before.
class Texture {
 public:
  /// Errors: those of decodePicture(). A JPEG may be decoded at half (`first_level` 1) or a quarter (2) of its size,
  /// which takes half the time; other pictures are decoded at their own. `units` may get what
  /// base::JpegBlocks::readQuarter tells.
  static base::Result<Texture> decode(base::ByteView bytes, int first_level = 0, base::Bytes* units = nullptr,
                                      bool opaque = false);
  explicit Texture(base::Image picture);
  int width() const { return size_.x; }
  int height() const { return size_.y; }
  std::size_t bytes() const;
  /// Means over fewer texels than 2^level a side are coarser than they should be.
  int firstLevel() const { return first_level_; }
  /// The level of the pyramid for means over so many texels a side; the largest is the one of a single texel.
  static int levelFor(double texels);
  /// The mean over about `texels` x `texels` texels around (u, v), where the picture is repeated. u runs to the right
  /// and v downwards, 0..1 across the picture. NaN gives grey.
  glm::u8vec4 mean(const glm::dvec2& uv, double texels) const;
  /// A corner, its two neighbours and the one opposite of it, in texture coordinates.
  using Quad = std::array<glm::dvec2, 4>;
  /// The mean of `n` x `n` such means, 1 <= n <= 15, spread evenly over a quadrilateral.
  glm::u8vec4 mean(const Quad& quad, int n, double texels) const;

 private:
  void halve();

  glm::ivec2 size_{0};
  int first_level_ = 0;              // of levels_
  std::vector<base::Image> levels_;  // 3 channels
};

/// Bakes polygons, and measures how much finer the textures are than the mesh.
class TextureBaker {
 public:
  static constexpr int kCoarsest = 2;  ///< level, a quarter of the size; coarser ones are no faster to decode
  /// The coarsest level, up to that, of a picture of this size that is fine enough for bake().
  static int levelFor(const glm::ivec2& size, std::span<const glm::dvec2> uv);
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
/// ceiling, so that hundreds of them take no more memory than a few. Not for use by several threads, though it has some
/// of its own, which decode pictures ahead.
class Textures {
 public:
  /// `path` is the mesh file's.
  explicit Textures(std::string path) : path_(std::move(path)) {}
  /// Where a file lies that the mesh file names: beside it, unless the name is a whole path. Windows programs write
  /// backslashes, letters in another case and paths on a disk that is elsewhere: then it is the file of that name
  /// beside the mesh file. Valid as long as this is.
  const std::string& pathOf(const std::string& name);
  /// The mesh file itself, for pictures inside it.
  const std::string& path() const { return path_; }
  /// Hands on the units of pictures that it decodes from now on; `keep` may be empty.
  void keepUnits(KeepUnits keep) { keep_units_ = std::move(keep); }
  /// Pictures that will probably be asked for, in this order.
  void expect(std::vector<SourcePicture> pictures) { expected_ = std::move(pictures); }
  /// The number of a picture; kNoPicture where it cannot be read, for which `warnings` gets a line, for the
  /// first few. `uv` are the corners of the polygon that shows it next: it is decoded fine enough for them at once.
  std::uint32_t find(const SourcePicture& picture, std::span<const glm::dvec2> uv, std::vector<std::string>& warnings);
  /// The picture that find() returned last, decoded, as fine as it is so far; valid until the next call.
  const Texture& operator[](std::uint32_t number) const { return *known_[number].decoded; }
  /// The same, at this level or a finer one.
  const Texture& fine(std::uint32_t number, int level);
  /// How many cannot be read beyond those that find() named.
  std::size_t unnamed() const { return unreadable_.size() - std::min(unreadable_.size(), kMaxNamed); }
  /// Those that could be read, by number.
  std::vector<SourcePicture> pictures() const;

 private:
  struct Known {
    SourcePicture picture;
    std::unique_ptr<Texture> decoded;  // null while it is not kept
    std::uint64_t used = 0;
    std::size_t order = 0;  // of needed_, when it was decoded last
  };
  // A picture that is being decoded.
  struct Ahead {
    SourcePicture picture;
    std::size_t bytes = 0;  // that it will take
    int first_level = 0;
    std::future<base::Result<Texture>> texture;
  };
  static constexpr std::size_t kKeptBytes = std::size_t{192} << 20;  // a choice: two pictures of 4096 x 4096
  static constexpr std::size_t kAheadBytes = std::size_t{64} << 20;  // a choice: one, or four at a quarter
  static constexpr std::size_t kMaxNamed = 8;  // a choice, since a set of tiles may have thousands
  int usualLevel() const;
  base::Result<Texture> decoded(const SourcePicture& picture, int needed);
  base::Result<Texture> decodeFile(const SourcePicture& picture, int first_level) const;
  void decodeAhead(const SourcePicture& last);
  void forgetOldest(const Known& but);

  std::string path_;
  KeepUnits keep_units_;
  std::map<std::string, std::string> paths_;  // by the name in the mesh file
  std::vector<Known> known_;
  std::vector<SourcePicture> unreadable_;
  std::uint64_t uses_ = 0;
  std::uint32_t last_ = 0;  // the one found last, whose picture is kept
  // The finest level that was needed of each picture that was decoded so far, in the order of decoding.
  std::vector<int> needed_;
  static constexpr std::size_t kUsual = 4;  // a choice: of so many pictures before, the finest level is likely
  std::vector<SourcePicture> expected_;
  std::deque<Ahead> ahead_;  // the last member, so that its threads end before the others are destroyed
};

}  // namespace mesh
