#pragma once
// All triangles of the source on disk, along the Morton curve of their median codes, with the final attributes of their
// vertices. The triangles of a cell of the octree, however large, are a range of them.
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "lod/ingest/buckets.h"
#include "lod/ingest/spool.h"

namespace lod::hlod::builder {

/// A mark beside a corner's normal: all of the vertex' open edges are the source's own border.
inline constexpr std::uint32_t kOnRim = 1U << 24;

class OrderedTriangles {
 public:
  static constexpr std::uint64_t kBytes = 3 * sizeof(ingest::Corner);  ///< a triangle's on disk

  /// Writes `directory`/ordered. Triangles with the same corners and winding are one. `threads` buckets are in memory
  /// at a time. Errors: those of reading the buckets, kNoSpace, kIo, kCancelled by progress.
  static base::Result<OrderedTriangles> order(const ingest::Buckets& buckets, std::uint32_t lattice_bits,
                                              const std::string& directory, unsigned threads,
                                              const std::function<bool(double)>& progress);
  /// Writes the tables to store beside the file, with which open() opens it again.
  void writeTables(base::ByteWriter& out) const;
  static base::Result<OrderedTriangles> open(const std::string& directory, base::ByteReader& state);

  std::uint64_t count() const { return count_; }
  std::uint64_t duplicates() const { return duplicates_; }
  /// How many vertices there are, each lattice point counted once in each bucket but for the buckets' borders.
  std::uint64_t vertices() const { return vertices_; }
  bool hasColors() const { return colors_; }
  /// The number of the first triangle whose code is not below.
  base::Result<std::uint64_t> lowerBound(std::uint64_t code) const;
  /// Three corners for each of so many triangles. Colours have A = 255, or are 0 where there are none. The highest byte
  /// of normals is kOnRim or 0.
  base::Result<std::vector<ingest::Corner>> read(std::uint64_t first, std::uint64_t count) const;
  /// Frees the disk space; nothing can be read any more.
  void release();

 private:
  static constexpr std::uint64_t kStride = 64;
  ingest::SpoolFile file_;
  std::uint64_t count_ = 0, duplicates_ = 0, vertices_ = 0;
  bool colors_ = false;
  std::vector<std::uint64_t> sampled_;  // the code of every kStride-th triangle
};

}  // namespace lod::hlod::builder
