#pragma once
// A bucket's vertices become leaves (Rusinkiewicz and Levoy 2000, section 2.2): a sphere around each, as large as the
// largest bounding sphere of the triangles that touch it, so that no hole is left. Private to lod/build/qsplat.
//
// Vertices on bucket borders are leaves of the first bucket that uses them. What their triangles in other buckets ask
// for is gathered before, in one look at all buckets.
#include <vector>

#include "lod/build/buckets.h"
#include "lod/build/qsplat/leaf_source.h"

namespace lod::build::qsplat {

class MeshLeaves : public LeafSource {
 public:
  /// Both must outlive it.
  MeshLeaves(const Buckets& buckets, const SourceLattice& lattice) : buckets_(buckets), lattice_(lattice) {}
  /// Before anything else, or readBorder(). `threads`: as many buckets are in memory at a time. Errors: those of
  /// reading buckets; kCancelled when `progress`, told the share done, says so.
  base::Result<void> measureBorder(unsigned threads, const std::function<bool(double)>& progress);
  void writeBorder(base::ByteWriter& out) const;
  /// False when that is no border of these buckets.
  bool readBorder(base::ByteReader& in);

  std::size_t tiles() const override { return buckets_.count(); }
  std::uint64_t memoryOf(std::size_t bucket) const override { return kBytesPerTriangle * buckets_.triangles(bucket); }
  base::Result<std::vector<Splat>> leaves(std::size_t bucket) const override;

 private:
  static constexpr std::uint64_t kBytesPerTriangle = 300;
  // What the triangles around a vertex ask for.
  struct Around {
    double radius_squared = 0.0;  // lattice units
    float least_cosine = 1.0F;    // between its normal, as decoded, and the triangles'
    void add(const Around& other) {
      radius_squared = std::max(radius_squared, other.radius_squared);
      least_cosine = std::min(least_cosine, other.least_cosine);
    }
  };
  struct Border {
    Around around;
    std::uint32_t owner = 0xFFFFFFFFU;  // bucket
  };
  struct Triangle;
  Splat leaf(std::uint64_t code, const VertexSums& sums, const Around& around) const;

  const Buckets& buckets_;
  const SourceLattice& lattice_;
  std::vector<Border> border_;  // as many as buckets_.border()
};

}  // namespace lod::build::qsplat
