#pragma once
// Makes leaves of points without faces (Rusinkiewicz and Levoy 2000, section 2.2: "we would have to compute normals by
// fitting a plane to the vertices in a small neighborhood around each point").
//
// A leaf's radius reaches to the end of its Voronoi cell in the fitted plane, so that no hole is left, but no farther
// than its sixth neighbour, and to a side without neighbours, at the rim of the cloud, no farther than is usual among
// those around it. A stray point, which hardly any other has among its nearest, is as large as is usual in its tile.
// Normals that the file gives are kept. Fitted ones have no sign: neighbours are made to agree along a minimum spanning
// tree of their differences (Hoppe et al. 1992), within each tile first, then between tiles along their borders. A
// connected part of the cloud faces up at its highest point.
#include <functional>
#include <glm/glm.hpp>
#include <span>
#include <string>
#include <vector>

#include "base/geometry.h"
#include "lod/ingest/point_tiles.h"
#include "lod/ingest/record_log.h"
#include "lod/qsplat/builder/splat.h"

namespace lod::qsplat::builder {

/// The unit normal of the least-squares plane through the points, of either sign; +z where they lie on a line or at one
/// place.
glm::dvec3 planeNormal(std::span<const glm::dvec3> points);

/// Scene units.
struct CellLimits {
  double reach = 0.0;  ///< above 0; cells are cut off there
  double rim = 0.0;    ///< at most `reach`; there they are cut off if they are open to some side
  double open = 0.0;   ///< at most `rim`; there they are cut off to that side
};
/// The distance from `center` to the farthest corner of its Voronoi cell among `others`, projected along `normal`,
/// within the limits.
double cellReach(const glm::dvec3& center, const glm::dvec3& normal, std::span<const glm::dvec3> others,
                 const CellLimits& limits);

class PointLeaves : public LeafSource {
 public:
  /// `tiles` and `lattice` must outlive it. `given_normals` says that some points have one.
  PointLeaves(const ingest::PointTiles& tiles, const ingest::SourceLattice& lattice, bool given_normals)
      : tiles_(tiles), lattice_(lattice), given_normals_(given_normals) {}
  /// Must be called first, or reopen(). Fits all tiles, writes the leaves to the file `path`, and decides which way the
  /// normals face. `progress` gets the share done, and cancels by false. Errors: those of reading, kNoSpace, kIo,
  /// kCancelled.
  base::Result<void> fitAll(const std::string& path, unsigned threads, const std::function<bool(double)>& progress);
  /// Writes the state that reopen() needs beside the file. Errors of reopen(): kIo, damaged work files.
  void writeSigns(base::ByteWriter& out) const;
  base::Result<void> reopen(const std::string& path, base::ByteReader& signs);
  /// Sum of all normals by area.
  const glm::dvec3& facing() const { return facing_; }

  std::size_t tiles() const override { return tiles_.count(); }
  std::uint64_t memoryOf(std::size_t tile) const override { return kBytesPerPoint * tiles_.points(tile); }
  base::Result<TileLeaves> leaves(std::size_t tile) const override;

 private:
  static constexpr std::uint64_t kBytesPerPoint = 700;  // measured
  struct FittedTile;
  struct Orientation;
  base::Result<FittedTile> fit(std::size_t tile) const;
  base::Result<void> addNeighbours(std::size_t tile, std::span<const glm::vec3> positions, std::span<const float> ball,
                                   std::vector<ingest::SourcePoint>& points) const;
  // `tree_neighbours` has the same number for each of the tile's own points, the point itself where there are fewer.
  static void makeSignsAgree(FittedTile& out, std::span<const std::uint32_t> tree_neighbours);

  const ingest::PointTiles& tiles_;
  const ingest::SourceLattice& lattice_;
  const bool given_normals_;
  // A leaf whose normal agrees in sign with its part of the tile.
  struct StoredLeaf {
    base::Sphere sphere;
    glm::vec3 normal{0.0F};
    glm::u8vec4 color{0};
    std::uint32_t part = 0;
  };
  struct TileRecord {
    std::uint64_t offset = 0;
    std::uint64_t leaves = 0;
  };
  base::Result<void> store(std::size_t tile, const FittedTile& fitted);
  bool noteRecord(std::uint64_t offset, base::ByteView record);

  ingest::RecordLog fitted_;
  std::vector<TileRecord> records_;               // by tile
  std::vector<std::vector<std::uint8_t>> flips_;  // by tile and part: 1 where normals are to be flipped
  glm::dvec3 facing_{0.0};
};

}  // namespace lod::qsplat::builder
