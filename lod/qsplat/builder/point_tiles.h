#pragma once
// Sorts points without faces on disk into tiles along the Morton curve, each small enough to be worked on in memory.
#include <functional>
#include <string>
#include <vector>

#include "base/geometry.h"
#include "lod/ingest/buckets.h"

namespace lod::qsplat::builder {

/// All source points at one lattice point become one.
struct SourcePoint {
  std::uint64_t code = 0;
  glm::vec3 position{0.0F};  ///< scene-local
  glm::vec3 normal{0.0F};    ///< as given, of any length; zero where unknown
  glm::u8vec3 color{255};
};

class PointTiles {
 public:
  /// About the most points of a tile. It does not depend on the memory there is, since the tree must not.
  static constexpr std::uint64_t kPoints = ingest::Buckets::kVertices;

  /// Reads the source twice and writes `directory`/points. Errors: kNoSpace, kIo, kCancelled.
  static base::Result<PointTiles> sort(const ingest::SourceSpool& source, const ingest::SourceInfo& info,
                                       const ingest::SourceLattice& lattice, const std::string& directory,
                                       const std::function<bool(double)>& progress);
  /// Returns the tables to store beside the file.
  base::Bytes encodeTables() const;
  /// Opens the tiles again with their tables. Errors: kIo, damaged work files.
  static base::Result<PointTiles> open(const std::string& directory, const ingest::SourceLattice& lattice,
                                       base::ByteView state);

  std::size_t count() const { return tiles_.size(); }
  std::uint64_t points(std::size_t tile) const { return tiles_[tile].points; }
  /// The box of its points, scene-local.
  const base::Aabb& box(std::size_t tile) const { return tiles_[tile].box; }
  /// Returns the points in the order of their codes. Safe from several threads. Errors: those of reading.
  base::Result<std::vector<SourcePoint>> read(std::size_t tile) const;
  /// Frees the disk space; the points can no longer be read.
  void release() { file_.release(0, file_.size()); }

 private:
  struct Tile {
    std::vector<ingest::Extent> extents;
    std::uint64_t points = 0;
    base::Aabb box;
  };
  ingest::SpoolFile file_;
  ingest::SourceLattice lattice_;
  std::vector<Tile> tiles_;
};

}  // namespace lod::qsplat::builder
