#pragma once
// The points of a source, sorted on disk into tiles along the Morton curve: those of a cloud, or the vertices of a mesh
// that triangles use.
#include <functional>
#include <glm/glm.hpp>
#include <string>
#include <vector>

#include "base/geometry.h"
#include "lod/ingest/buckets.h"
#include "lod/ingest/source_lattice.h"
#include "lod/ingest/spool.h"

namespace lod::ingest {

/// All source points at one lattice point become one.
struct SourcePoint {
  std::uint64_t code = 0;
  glm::vec3 position{0.0F};  ///< scene-local
  glm::vec3 normal{0.0F};    ///< as given, of any length; zero where unknown
  glm::u8vec3 color{255};
};

/// The points, sorted on disk into tiles along the Morton curve, each small enough to be worked on in memory.
class PointTiles {
 public:
  /// About the most points of a tile. It does not depend on the memory there is, since the tree must not.
  static constexpr std::uint64_t kPoints = Buckets::kVertices;

  /// Reads the source twice and writes `directory`/points. Errors: kNoSpace, kIo, kCancelled.
  static base::Result<PointTiles> sort(const SourceSpool& source, const SourceInfo& info, const SourceLattice& lattice,
                                       const std::string& directory, const std::function<bool(double)>& progress);
  /// Returns the tables to store beside the file.
  base::Bytes encodeTables() const;
  /// Opens the tiles again with their tables. Errors: kIo, damaged work files.
  static base::Result<PointTiles> open(const std::string& directory, const SourceLattice& lattice,
                                       base::ByteView state);

  std::size_t count() const { return tiles_.size(); }
  std::uint64_t points(std::size_t tile) const { return tiles_[tile].points; }
  /// The box of its points, scene-local.
  const base::Aabb& box(std::size_t tile) const { return tiles_[tile].box; }
  /// Returns the points in the order of their codes. Safe from several threads. Errors: those of reading.
  base::Result<std::vector<SourcePoint>> read(std::size_t tile) const;
  /// The codes of all the tile's source points, in order. Safe from several threads. Errors: those of reading.
  base::Result<std::vector<std::uint64_t>> codes(std::size_t tile) const;
  /// Frees the disk space; the points can no longer be read.
  void release() { file_.release(0, file_.size()); }

 private:
  /// A source point as it lies in the file.
  struct Record {
    std::uint64_t code = 0;
    std::uint32_t color = 0;   ///< R G B A from the lowest byte; A = 0 where unknown
    std::uint32_t normal = 0;  ///< packNormal; 0 where unknown
  };
  struct Tile {
    std::vector<Extent> extents;
    std::uint64_t points = 0;
    base::Aabb box;
  };
  base::Result<std::vector<Record>> readRecords(std::size_t tile) const;
  SpoolFile file_;
  SourceLattice lattice_;
  std::vector<Tile> tiles_;
};

}  // namespace lod::ingest
