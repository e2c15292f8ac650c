#pragma once
// The first work files of a build: the vertices and triangles of all source files in their order. Memory holds one bit
// per vertex and a fixed buffer.
#include <array>
#include <string>
#include <unordered_set>
#include <vector>

#include "lod/ingest/picture_units.h"
#include "lod/ingest/spool.h"
#include "lod/morton.h"
#include "mesh/stream_mesh.h"

namespace lod::ingest {

/// Tells colours of materials or classes from scanned ones by their number. Greys alone may be intensities.
class FewColors {
 public:
  void add(const glm::u8vec4& color) {
    const std::uint32_t code = color.r | std::uint32_t{color.g} << 8 | std::uint32_t{color.b} << 16;
    if (code == last_ || seen_.size() > kFew) return;
    last_ = code;
    seen_.insert(code);
    has_hue_ = has_hue_ || color.r != color.g || color.g != color.b;
  }
  bool areOfPaint() const { return has_hue_ && seen_.size() <= kFew; }

 private:
  // A choice: plans of buildings and machines have a few dozen materials, and scans of a thousand triangles have more.
  static constexpr std::size_t kFew = 256;
  std::unordered_set<std::uint32_t> seen_;
  std::uint32_t last_ = 0xFFFFFFFFU;  // no colour's
  bool has_hue_ = false;
};

/// Properties of all source files together.
struct SourceInfo {
  std::uint64_t vertices = 0;    ///< sum over all files
  std::uint64_t triangles = 0;   ///< sum over all files
  std::uint64_t referenced = 0;  ///< vertices of triangles that do not name one twice
  bool has_normals = false;      ///< some vertices came with one
  bool has_colors = false;
  bool is_painted = false;  ///< triangles in at most 256 different colours: of materials or classes, not scanned
  glm::dvec3 box_min{0.0};  ///< box of the referenced vertices, world
  glm::dvec3 box_max{0.0};
  /// World; of the vertices that touch the box, the one that is farthest from the middle of all along an axis. A few
  /// stray vertices that make a box large are there.
  glm::dvec3 far_place{0.0};
  double mean_edge = 0.0;   ///< geometric mean over a sample of the edges; 0 when all are points
  double short_edge = 0.0;  ///< a tenth of the sampled edges are shorter; 0 when all are points
  double coincident = 0.0;  ///< share of the sampled triangles of which two vertices lie in one place, 0 … 1
  /// By position bits, 10 … 21: the share of the sampled triangles, besides the coincident ones, of which two vertices
  /// meet at a point of the lattice of so many bits, 0 … 1.
  std::array<double, kMaxLatticeBits + 1> lost{};
  mesh::Georeference georeference;  ///< as far as the files agree
  std::vector<std::string> warnings;
  std::vector<std::string> texture_warnings;  ///< due where textures only colour vertices
  std::vector<mesh::SourcePicture> pictures;  ///< of all files, as triangles number them
  double texels = 0.0;                        ///< of the pictures, as many as triangles cover
  std::uint64_t short_faces = 0;              ///< faces of fewer than three corners, which readers leave out
};

/// Vertices and triangles of a block, numbered through all files. `packed` is scratch memory that reads use again.
struct SpooledVertices {
  std::uint64_t first = 0;
  std::vector<glm::dvec3> positions;
  std::vector<std::uint32_t> normals;  ///< packed, 0 where unknown; empty when the block has none
  std::vector<std::uint32_t> colors;   ///< R G B A from the lowest byte, A = 255; empty when the block has none
  base::Bytes packed;
};
struct SpooledTriangles {
  std::uint64_t first = 0;
  std::vector<std::uint64_t> corners;
  std::vector<std::uint32_t> colors;    ///< per corner, A = 0 where unknown; empty when the block has none
  std::vector<std::uint32_t> normals;   ///< per corner, packed, 0 where unknown; empty when the block has none
  std::vector<glm::vec2> uv;            ///< per corner, as mesh::TriangleBlock has it; empty when the block has none
  std::vector<std::uint32_t> pictures;  ///< per triangle, of SourceInfo::pictures or mesh::kNoPicture; the same
  base::Bytes packed;
};

/// A unit vector in 3 × 8 bits with a mark in the highest byte; 0 for a zero vector or NaN.
std::uint32_t packNormal(const glm::vec3& n);
/// The components as whole numbers −127 … 127; all zero for 0.
glm::ivec3 unpackNormal(std::uint32_t packed);

class SourceSpool : public mesh::MeshSink {
 public:
  /// Creates the files `vertices` and `triangles` in `directory`, and that of PictureUnits. Errors: kNoSpace, kIo.
  static base::Result<SourceSpool> create(const std::string& directory);
  /// Opens the files that an earlier run finished. Errors: kNotFound, kIo, damaged work files.
  static base::Result<SourceSpool> open(const std::string& directory);

  base::Result<void> vertices(const mesh::VertexBlock& block) override;
  base::Result<void> triangles(const mesh::TriangleBlock& block) override;
  base::Result<void> restart() override;

  /// Called before each source file, whose numbers start at 0. `name` is the file's in errors.
  void beginFile(const std::string& name);
  /// Keeps the units that mesh::StreamOptions::keep_units gets, for PictureUnits. Safe from several threads.
  void keepUnits(const mesh::SourcePicture& picture, base::ByteView units) { units_.add(picture, units); }
  /// Called after each source file that has textures: its pictures, in their order.
  void addPictures(const std::vector<mesh::SourcePicture>& pictures) {
    info_.pictures.insert(info_.pictures.end(), pictures.begin(), pictures.end());
  }
  /// Called after the last file: flushes, and reads all vertices once to measure them. A source without triangles is an
  /// error unless `accepts_points`; then every vertex counts as referenced. Errors: those of reading, kInvalidInput
  /// where the source is empty.
  base::Result<SourceInfo> finish(bool accepts_points, unsigned threads);
  /// The sizes of both files in bytes.
  std::uint64_t vertexBytes() const { return vertices_.size(); }
  std::uint64_t triangleBytes() const { return triangles_.size(); }

  /// Blocks hold some ten thousand vertices or triangles, in the source's order. Reading is safe from several threads.
  /// Errors: kIo.
  std::size_t vertexBlocks() const { return vertex_blocks_.size(); }
  std::size_t triangleBlocks() const { return triangle_blocks_.size(); }
  base::Result<void> readVertices(std::size_t block, SpooledVertices& out) const;
  base::Result<void> readTriangles(std::size_t block, SpooledTriangles& out) const;
  /// A block has vertices first … first + count − 1.
  std::uint64_t firstVertex(std::size_t block) const { return vertex_blocks_[block].first; }
  std::uint64_t vertexCount(std::size_t block) const { return vertex_blocks_[block].count; }
  /// Calls body(SpooledVertices) for each block in order; body returns Result<void>.
  template <class Body>
  base::Result<void> forEachVertexBlock(Body&& body) const {
    SpooledVertices block;
    for (std::size_t b = 0; b < vertexBlocks(); ++b) {
      LUMIGRID_TRY(readVertices(b, block));
      LUMIGRID_TRY(body(static_cast<const SpooledVertices&>(block)));
    }
    return {};
  }
  /// Deletes both files in the directory. Who has them open can still read them.
  static void remove(const std::string& directory);

 private:
  struct FileStart {  // where the current source file began
    std::uint64_t vertices = 0, triangles = 0, vertex_bytes = 0, triangle_bytes = 0;
  };
  struct Block {
    std::uint64_t first = 0;   // number of its first vertex or triangle
    std::uint64_t offset = 0;  // where its header lies
    std::uint32_t count = 0;
    std::uint32_t flags = 0;
  };
  SourceSpool(SpoolFile vertices, SpoolFile triangles)
      : vertices_(std::move(vertices)), triangles_(std::move(triangles)) {}
  base::Result<void> findBlocks(const std::string& directory);
  static base::Result<base::ByteView> readPacked(const SpoolFile& file, const Block& block, std::uint64_t bytes,
                                                 base::Bytes& packed);
  void sample(std::span<const std::uint64_t> corners);
  base::Result<void> measure(unsigned threads);
  void measureEdges(std::span<const glm::dvec3> corners);
  double lostShare(std::span<const glm::dvec3> corners, std::uint32_t bits) const;
  struct BlockMeasure;
  struct SampledCorners;
  base::Result<void> measureBlock(std::size_t block, BlockMeasure& out, SampledCorners& sampled) const;

  SpoolFile vertices_;
  SpoolFile triangles_;
  PictureUnits units_;
  std::vector<Block> vertex_blocks_;
  std::vector<Block> triangle_blocks_;
  SourceInfo info_;
  FileStart file_;
  std::string name_;
  std::vector<std::uint64_t> used_;     // one bit per vertex
  std::vector<std::uint64_t> sampled_;  // corners of every sample_stride_-th triangle
  std::uint64_t sample_stride_ = 1;
  FewColors colors_;
  base::Bytes scratch_;
};

}  // namespace lod::ingest
