#pragma once
// A bucket's vertices become leaves (Rusinkiewicz and Levoy 2000, section 2.2): a sphere around each, as large as the
// largest bounding sphere of the triangles that touch it, so that no hole is left. Private to lod/build/qsplat.
//
// Triangles much larger than is usual around them would make leaves of their size: they are diced first (dice.h), and
// the points between their pieces are leaves too.
//
// Vertices on bucket borders are leaves of the first bucket that uses them. What their triangles in other buckets ask
// for is gathered before, in one look at all buckets.
#include <limits>
#include <vector>

#include "lod/ingest/buckets.h"
#include "lod/qsplat/builder/dice.h"
#include "lod/qsplat/builder/leaf_source.h"

namespace lod::qsplat::builder {

class MeshLeaves : public LeafSource {
 public:
  /// The first two must outlive it. `dice`: an edge of so many times its bucket's mean (geometric, of the triangles'
  /// longest edges) is cut, or of more where that would add too many leaves (docs/formats/qsplat.md); 0: none is.
  MeshLeaves(const ingest::Buckets& buckets, const ingest::SourceLattice& lattice, double dice)
      : buckets_(buckets), lattice_(lattice), dice_(dice) {}
  /// Before anything else, or readBorder(). `threads`: as many buckets are in memory at a time. Errors: those of
  /// reading buckets; kCancelled when `progress`, told the share done, says so.
  base::Result<void> measureBorder(unsigned threads, const std::function<bool(double)>& progress);
  void writeBorder(base::ByteWriter& out) const;
  /// False when that is no border of these buckets.
  bool readBorder(base::ByteReader& in);

  std::size_t tiles() const override { return buckets_.count(); }
  std::uint64_t memoryOf(std::size_t bucket) const override {
    return kBytesPerTriangle * (buckets_.triangles(bucket) + (cuts_.empty() ? 0 : cuts_[bucket].count));
  }
  base::Result<TileLeaves> leaves(std::size_t bucket) const override;
  /// At most so many leaves are added by dicing. After measureBorder() or readBorder().
  std::uint64_t mostAdded() const;

 private:
  static constexpr std::uint64_t kBytesPerTriangle = 300;
  // What the triangles around a vertex ask for.
  struct Around {
    double radius_squared = 0.0;  // lattice units
    float least_cosine = 1.0F;    // between its normal, as decoded, and the triangles'
    std::uint64_t area = 0;       // of the triangles, lattice units, twice
    std::uint64_t own = 0;        // of their pieces around the vertex
    void add(const Around& other) {
      radius_squared = std::max(radius_squared, other.radius_squared);
      least_cosine = std::min(least_cosine, other.least_cosine);
      area += other.area;
      own += other.own;
    }
  };
  // How a bucket's triangles are diced.
  struct Cuts {
    double longest = std::numeric_limits<double>::infinity();  // edge that is left whole, lattice units
    std::uint64_t count = 0;
  };
  struct Border {
    Around around;
    std::uint32_t owner = 0xFFFFFFFFU;  // bucket
  };
  struct Triangle;
  struct Piece;
  struct Point;
  base::Result<Cuts> chooseCuts(std::size_t bucket) const;
  static Cuts leastCuts(std::span<const glm::ivec3> points, double least, std::uint64_t most);
  std::vector<std::pair<std::uint32_t, Around>> aroundBorder(std::span<const ingest::BorderTriangle> triangles,
                                                             std::span<const glm::vec3> normals, double longest) const;
  static Point vertex(const ingest::VertexSums& sums);
  // A triangle that lies outside the narrow cone around a point's normal (LeafFacets).
  struct Outlier {
    std::uint32_t point = 0;
    std::uint32_t triangle = 0;
  };
  static void addPieces(const Dicer& dicer, std::span<const Triangle> triangles, std::vector<Point>& points,
                        std::vector<Outlier>& outliers);
  static LeafFacets facetsOf(std::span<const Outlier> outliers, std::span<const std::uint32_t> leaf_of_point,
                             std::size_t leaves, std::span<const Triangle> triangles);
  Splat leaf(const glm::dvec3& place, const Point& point, const Around& around) const;

  const ingest::Buckets& buckets_;
  const ingest::SourceLattice& lattice_;
  const double dice_;
  std::vector<Cuts> cuts_;      // by bucket
  std::vector<Border> border_;  // as many as buckets_.border()
};

}  // namespace lod::qsplat::builder
