#pragma once
// Points without faces become leaves (Rusinkiewicz and Levoy 2000, section 2.2: "we would have to compute normals by
// fitting a plane to the vertices in a small neighborhood around each point"). Private to lod/build/qsplat.
//
// Radius: as far as the point's Voronoi cell in the plane fitted reaches, which is what it has to cover if no hole is
// to be left; at the rim of the cloud as far as its sixth neighbour. Normals that the file gives are kept. Fitted ones
// have no sign: neighbours are made to agree along a minimum spanning tree of their differences (Hoppe et al. 1992),
// within each tile first, then tile by tile along their borders; what hangs together faces up at its highest point.
#include <vector>

#include "lod/ingest/record_log.h"
#include "lod/qsplat/builder/leaf_source.h"
#include "lod/qsplat/builder/point_tiles.h"

namespace lod::qsplat::builder {

class PointLeaves : public LeafSource {
 public:
  /// All must outlive it. `given_normals`: some points have one.
  PointLeaves(const PointTiles& tiles, const ingest::SourceLattice& lattice, bool given_normals)
      : tiles_(tiles), lattice_(lattice), given_normals_(given_normals) {}
  /// Before anything else, or reopen(): fits all tiles, into the file `path`, and finds which way the normals face.
  /// Errors: those of reading, kNoSpace, kIo; kCancelled when `progress`, told the share done, says so.
  base::Result<void> fitAll(const std::string& path, unsigned threads, const std::function<bool(double)>& progress);
  /// What decides besides that file; and both as an earlier run left them. Errors: kIo, damaged work files.
  void writeSigns(base::ByteWriter& out) const;
  base::Result<void> reopen(const std::string& path, base::ByteReader& signs);
  /// Sum of all normals by area.
  const glm::dvec3& facing() const { return facing_; }

  std::size_t tiles() const override { return tiles_.count(); }
  std::uint64_t memoryOf(std::size_t tile) const override { return kBytesPerPoint * tiles_.points(tile); }
  base::Result<TileLeaves> leaves(std::size_t tile) const override;

 private:
  static constexpr std::uint64_t kBytesPerPoint = 700;
  struct Fitted;
  base::Result<Fitted> fit(std::size_t tile) const;
  base::Result<void> addNeighbours(std::size_t tile, std::span<const glm::vec3> positions, std::span<const float> ball,
                                   std::vector<Point>& points) const;
  // `tree_neighbours`: so many for each of its own points, itself where there are fewer.
  static void makeSignsAgree(Fitted& out, std::span<const std::uint32_t> tree_neighbours);

  const PointTiles& tiles_;
  const ingest::SourceLattice& lattice_;
  const bool given_normals_;
  // A leaf whose normal has the sign of its part.
  struct Stored {
    base::Sphere sphere;
    glm::vec3 normal{0.0F};
    glm::u8vec4 color{0};
    std::uint32_t part = 0;
  };
  struct Place {
    std::uint64_t offset = 0;
    std::uint64_t leaves = 0;
  };
  base::Result<void> store(std::size_t tile, const Fitted& fitted);
  bool place(std::uint64_t offset, base::ByteView record);

  ingest::RecordLog fitted_;
  std::vector<Place> places_;                     // by tile
  std::vector<std::vector<std::uint8_t>> flips_;  // by tile, of its parts: 1 where they are to be turned
  glm::dvec3 facing_{0.0};
};

}  // namespace lod::qsplat::builder
