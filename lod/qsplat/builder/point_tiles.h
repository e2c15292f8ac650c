#pragma once
// Points without faces, sorted to disk into tiles along the Morton curve, each small enough to be worked on in memory.
// Private to lod/build/qsplat.
#include <functional>
#include <string>
#include <vector>

#include "base/geometry.h"
#include "lod/ingest/buckets.h"

namespace lod::qsplat::builder {

/// Points at one lattice point are one.
struct Point {
  std::uint64_t code = 0;
  glm::vec3 position{0.0F};  ///< scene-local
  glm::vec3 normal{0.0F};    ///< as given, any length; zero: none
  glm::u8vec3 color{255};
};

class PointTiles {
 public:
  /// Most points of a tile, about. A constant: the tree must not depend on the memory there is.
  static constexpr std::uint64_t kPoints = ingest::Buckets::kVertices;

  /// Reads the source twice and writes `directory`/points. Errors: kNoSpace, kIo, kCancelled.
  static base::Result<PointTiles> sort(const ingest::SourceSpool& source, const ingest::SourceInfo& info,
                                       const ingest::SourceLattice& lattice, const std::string& directory,
                                       const std::function<bool(double)>& progress);
  /// State to write beside the file, and back. Errors: kIo, damaged work files.
  base::Bytes state() const;
  static base::Result<PointTiles> open(const std::string& directory, const ingest::SourceLattice& lattice,
                                       base::ByteView state);

  std::size_t count() const { return tiles_.size(); }
  std::uint64_t points(std::size_t tile) const { return tiles_[tile].points; }
  /// Of its points, scene-local.
  const base::Aabb& box(std::size_t tile) const { return tiles_[tile].box; }
  /// In the order of their codes. Safe from several threads. Errors: those of reading.
  base::Result<std::vector<Point>> read(std::size_t tile) const;
  /// Gives the disk space back; the points can no longer be read.
  void release() { file_.release(0, file_.size()); }

 private:
  struct Extent {
    std::uint64_t offset = 0;
    std::uint64_t bytes = 0;
  };
  struct Tile {
    std::vector<Extent> extents;
    std::uint64_t points = 0;
    base::Aabb box;
  };
  ingest::SpoolFile file_;
  ingest::SourceLattice lattice_;
  std::vector<Tile> tiles_;
};

}  // namespace lod::qsplat::builder
