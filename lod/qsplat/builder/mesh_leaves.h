#pragma once
// Makes leaves of a bucket's vertices (Rusinkiewicz and Levoy 2000, section 2.2). The sphere of a vertex is as large as
// the largest bounding sphere of the triangles that touch it, so that no hole is left.
//
// Triangles much larger than those around them would make leaves of their size, so they are diced first (dice.h), and
// the points between their sub-triangles become leaves too.
//
// Vertices on bucket borders are leaves of the first bucket that uses them. A pass over all buckets measures their
// triangles in the other buckets beforehand.
#include <limits>
#include <vector>

#include "lod/ingest/buckets.h"
#include "lod/qsplat/builder/dice.h"
#include "lod/qsplat/builder/splat.h"

namespace lod::qsplat::builder {

/// The area, sizes and directions that a leaf has to cover: all triangles around its vertex.
struct Surroundings {
  double radius_squared = 0.0;  // lattice units
  float least_cosine = 1.0F;    // between its normal, as decoded, and the triangles'
  std::uint64_t area = 0;       // area of the triangles, in half squared lattice steps
  std::uint64_t own = 0;        // the part of it in sub-triangles at the vertex
  void add(const Surroundings& other) {
    radius_squared = std::max(radius_squared, other.radius_squared);
    least_cosine = std::min(least_cosine, other.least_cosine);
    area += other.area;
    own += other.own;
  }
};

/// How a bucket's triangles are diced.
struct DiceLimit {
  double longest = std::numeric_limits<double>::infinity();  // edge that is not cut, lattice steps
  std::uint64_t cuts = 0;
};

class MeshLeaves : public LeafSource {
 public:
  /// `buckets` and `lattice` must outlive it. Edges longer than `dice` times the geometric mean of the longest edges of
  /// the bucket's triangles are cut, or only longer ones where that would add too many leaves (docs/formats/qsplat.md);
  /// 0: none is cut.
  MeshLeaves(const ingest::Buckets& buckets, const ingest::SourceLattice& lattice, double dice)
      : buckets_(buckets), lattice_(lattice), dice_(dice) {}
  /// Must be called first, or readBorder(). `threads` buckets are in memory at a time. `progress` gets the share done,
  /// and cancels by false. Errors: those of reading buckets, kCancelled.
  base::Result<void> measureBorder(unsigned threads, const std::function<bool(double)>& progress);
  void writeBorder(base::ByteWriter& out) const;
  /// False where the border is not of these buckets.
  bool readBorder(base::ByteReader& in);

  std::size_t tiles() const override { return buckets_.count(); }
  std::uint64_t memoryOf(std::size_t bucket) const override {
    return kBytesPerTriangle * (buckets_.triangles(bucket) + (limits_.empty() ? 0 : limits_[bucket].cuts));
  }
  base::Result<TileLeaves> leaves(std::size_t bucket) const override;
  /// The most leaves that dicing adds; known after measureBorder() or readBorder().
  std::uint64_t maxAddedLeaves() const;

 private:
  static constexpr std::uint64_t kBytesPerTriangle = 300;  // measured on scans with colours
  struct BorderLeaf {
    Surroundings around;
    std::uint32_t owner = 0xFFFFFFFFU;  // bucket
  };
  base::Result<DiceLimit> chooseLimit(std::size_t bucket) const;

  const ingest::Buckets& buckets_;
  const ingest::SourceLattice& lattice_;
  const double dice_;
  std::vector<DiceLimit> limits_;   // by bucket
  std::vector<BorderLeaf> border_;  // as many as buckets_.border()
};

}  // namespace lod::qsplat::builder
