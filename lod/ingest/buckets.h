#pragma once
// The source's triangles on the lattice, sorted to disk into buckets along the Morton curve, each small enough to be
// worked on in memory (DESIGN section 4, step 1; sorting by sampled splitters).
//
// A triangle lies in the bucket of its median code, so a voxel's triangles lie in one bucket. Vertices are known by
// their lattice points alone: what meets there is one vertex, in whatever bucket, file or level.
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/resource_limits.h"
#include "lod/ingest/morton.h"
#include "lod/ingest/source_spool.h"
#include "lod/ingest/winding.h"
#include "lod/lattice.h"

namespace lod::ingest {

/// The lattice laid over the source: q = round((world − corner) / step), 0 … 2^bits − 1 on each axis.
struct SourceLattice {
  glm::dvec3 corner{0.0};  ///< world position of lattice point 0
  Lattice lattice;         ///< the same relative to the scene's origin
  std::uint32_t bits = 10;

  glm::ivec3 point(const glm::dvec3& world) const;
};
/// `bits` 0 chooses: one step is at most 1/16 of the mean edge, within 14 … 21. `origin`: the scene's.
SourceLattice makeLattice(const SourceInfo& info, const glm::dvec3& origin, std::uint32_t bits);

struct Corner {
  std::uint64_t code = 0;
  std::uint32_t color = 0;   ///< R G B A from the lowest byte; A = 0: none
  std::uint32_t normal = 0;  ///< packNormal; 0: none
};

/// What vertices on bucket borders add up to over all buckets; sums of whole numbers, so that their order is no matter.
struct VertexSums {
  std::int64_t face[3] = {0, 0, 0};    ///< of the triangles' normals, twice their area
  std::int64_t normal[3] = {0, 0, 0};  ///< of the given normals
  std::int64_t color[3] = {0, 0, 0};
  std::int64_t colored = 0;  ///< how many colours

  /// One corner's share; `face` is the normal of its triangle.
  void add(const glm::i64vec3& face_normal, const Corner& corner) {
    for (int k = 0; k < 3; ++k) face[k] += face_normal[k];
    if (corner.normal != 0) {
      const glm::ivec3 given = unpackNormal(corner.normal);
      for (int k = 0; k < 3; ++k) normal[k] += given[k];
    }
    if (corner.color >> 24 == 0) return;
    for (int k = 0; k < 3; ++k) color[k] += corner.color >> (8 * k) & 255U;
    ++colored;
  }
  /// Unit: the given normal, or else the triangles'; +z where nothing is known.
  glm::vec3 unitNormal() const;
  /// White where no colour is known.
  glm::u8vec4 meanColor() const;
};

/// Vertices that several buckets use, by Morton code, ascending.
struct BorderVertices {
  std::vector<std::uint64_t> codes;
  std::vector<VertexSums> sums;  ///< as many
  /// A bit per hash of a code: most vertices are found not to be among them at once.
  std::vector<bool> filter;
  void makeFilter();
  /// Its place, or -1.
  std::int64_t find(std::uint64_t code) const;
};

/// A triangle with a corner on the border.
struct BorderTriangle {
  std::uint32_t triangle = 0;                                           ///< its place in the bucket
  std::uint32_t place[3] = {kNotOnBorder, kNotOnBorder, kNotOnBorder};  ///< of its corners in the border
  Corner corner[3];
};

struct BucketCounts {
  std::uint64_t triangles = 0;   ///< in buckets
  std::uint64_t degenerate = 0;  ///< left out: a corner named twice
  std::uint64_t collapsed = 0;   ///< left out: corners that met on the lattice
  glm::dvec3 facing{0.0};        ///< sum of the triangles' normals, twice their area
};

struct BucketOptions {
  base::ResourceLimits limits;           ///< resolved; memory for the window of vertices
  std::function<bool(double)> progress;  ///< false cancels
};

class Buckets {
 public:
  /// Most vertices of a bucket, about. A constant: the hierarchy must not depend on the memory there is.
  static constexpr std::uint64_t kVertices = std::uint64_t{1} << 17;

  /// Reads the source once for every window of vertices that fits the memory. Writes `directory`/buckets (and
  /// `directory`/corners meanwhile, where several windows are needed). Errors: kNoSpace, kIo, kCancelled,
  /// kInvalidInput (no triangle keeps its area on the lattice).
  static base::Result<Buckets> sort(const SourceSpool& source, const SourceInfo& info, const SourceLattice& lattice,
                                    const std::string& directory, const BucketOptions& options);
  /// State to write beside the file, and back.
  base::Bytes state() const;
  static base::Result<Buckets> open(const std::string& directory, base::ByteView state);

  std::size_t count() const { return extents_.size(); }
  std::uint64_t triangles(std::size_t bucket) const { return counts_[bucket]; }
  const BucketCounts& totals() const { return totals_; }
  const BorderVertices& border() const { return border_; }
  bool hasColors() const { return has_colors_; }
  bool hasNormals() const { return has_normals_; }

  const Winding& winding() const { return winding_; }

  /// 3 corners per triangle, in the source's order, wound alike.
  base::Result<std::vector<Corner>> read(std::size_t bucket) const;
  /// The same with its vertices numbered. A mesh of a single bucket lies ready for the first call; one call at a time.
  struct Numbered {
    std::vector<Corner> corners;
    NumberedCorners mesh;
  };
  base::Result<Numbered> readNumbered(std::size_t bucket) const;
  /// The same with its vertices numbered where they lie ready so; else `mesh` is empty.
  base::Result<Numbered> readOnce(std::size_t bucket) const;
  /// Those with a corner on the border, as read() has them.
  base::Result<std::vector<BorderTriangle>> borderTriangles(std::size_t bucket) const;
  /// Gives the buckets' disk space back; they can no longer be read.
  void release();

 private:
  struct Extent {
    std::uint64_t offset = 0;
    std::uint64_t bytes = 0;
  };
  struct Area {
    std::uint64_t triangles = 0;  // whose corners lie on no line
    glm::dvec3 facing{0.0};
  };
  std::size_t cornerBytes() const { return 8 + (has_colors_ ? 4U : 0U) + (has_normals_ ? 4U : 0U); }
  std::size_t borderTriangleBytes() const { return 16 + 3 * cornerBytes(); }
  std::uint8_t* pack(const Corner& corner, std::uint8_t* to) const;
  std::uint8_t* packAttributes(const Corner& corner, std::uint8_t* to) const;
  /// `before`: the first corner's code of the triangle before in the run, and then of this one.
  std::uint8_t* packTriangle(std::span<const Corner, 3> corner, bool starts_run, std::uint64_t& before,
                             std::uint8_t* to) const;
  const std::uint8_t* unpack(const std::uint8_t* from, Corner& corner) const;
  const std::uint8_t* unpackAttributes(const std::uint8_t* from, Corner& corner) const;
  const std::uint8_t* unpackTriangle(const std::uint8_t* from, std::span<Corner, 3> corner,
                                     std::uint64_t& before) const;
  base::Result<std::vector<Corner>> readAsGiven(std::size_t bucket) const;
  /// Of each vertex on the border; kNotOnBorder for others.
  std::vector<std::uint32_t> borderPlaces(const NumberedCorners& mesh) const;
  base::Result<void> storeBorder(std::size_t bucket, std::span<const BorderTriangle> triangles);
  base::Result<std::vector<BorderTriangle>> borderAsGiven(std::size_t bucket) const;
  void addToBorders(std::span<const BorderTriangle> triangles);

  /// A bit per triangle that is to be turned over; empty: none.
  using Flips = std::vector<bool>;
  Flips flipsOf(std::size_t bucket, std::span<const std::uint32_t> part) const;
  base::Result<Flips> measureFlips(std::size_t bucket) const;
  base::Result<void> windAlike(base::ResourceLimits limits);
  struct FirstLook;
  base::Result<void> lookAt(std::size_t bucket, FirstLook& look);
  BucketWinding measure(const NumberedCorners& mesh, std::span<const std::uint32_t> places, FirstLook& look) const;
  base::Result<void> turnOver(FirstLook& look, unsigned threads);
  static Area areaOf(const NumberedCorners& mesh);

  friend class BucketSorter;
  SpoolFile file_;
  std::vector<std::vector<Extent>> extents_;
  std::vector<std::uint64_t> counts_;
  BucketCounts totals_;
  BorderVertices border_;
  std::vector<Extent> border_extents_;  // by bucket: its BorderTriangles
  Winding winding_;
  std::vector<Flips> flips_;              // by bucket, where they have been measured in this run; else empty
  std::vector<Area> areas_;               // by bucket, until they are summed
  mutable std::optional<Numbered> only_;  // of a single bucket, until it is asked for
  bool has_colors_ = false;
  bool has_normals_ = false;
};

/// Twice the triangle's area times its normal, on the lattice: exact.
inline glm::i64vec3 latticeNormal(const glm::ivec3& a, const glm::ivec3& b, const glm::ivec3& c) {
  const glm::i64vec3 u(b - a);
  const glm::i64vec3 v(c - a);
  return {u.y * v.z - u.z * v.y, u.z * v.x - u.x * v.z, u.x * v.y - u.y * v.x};
}

}  // namespace lod::ingest
