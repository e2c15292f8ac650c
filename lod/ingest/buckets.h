#pragma once
// The source's triangles on the lattice, sorted on disk into buckets along the Morton curve (sample sort, Frazer and
// McKellar 1970), each small enough to be worked on in memory.
//
// A triangle lies in the bucket of its median code, so that a voxel's triangles lie in one bucket.
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/resource_limits.h"
#include "lod/ingest/border_vertices.h"
#include "lod/ingest/bucket_packing.h"
#include "lod/ingest/morton.h"
#include "lod/ingest/source_lattice.h"
#include "lod/ingest/stitching.h"
#include "lod/ingest/texture_places.h"
#include "lod/ingest/winding.h"

namespace lod::ingest {

struct BucketCounts {
  std::uint64_t triangles = 0;   ///< in buckets
  std::uint64_t degenerate = 0;  ///< left out, since they name a vertex twice
  std::uint64_t collapsed = 0;   ///< left out, since two corners met at a lattice point
  std::uint64_t two_sided = 0;   ///< left out, since they are another one turned over
  glm::dvec3 facing{0.0};        ///< sum of all latticeNormals
  std::uint64_t added = 0;       ///< by cutting others, or to close holes
  StitchCounts stitched;
};

struct BucketOptions {
  base::ResourceLimits limits;  ///< resolved; the memory bounds the window of vertices
  StitchOptions stitch;
  std::function<bool(double)> progress;  ///< share done; false cancels
  bool keeps_textures = false;           ///< triangles can be asked for their textures
};

class Buckets {
 public:
  /// About the most vertices of a bucket. It does not depend on the memory there is, since the hierarchy must not.
  static constexpr std::uint64_t kVertices = std::uint64_t{1} << 17;

  /// Reads the source once for every window of vertices that fits the memory. Writes `directory`/buckets, and
  /// `directory`/corners meanwhile where several windows are needed. Errors: kNoSpace, kIo, kCancelled, kInvalidInput
  /// (no triangle keeps its area on the lattice).
  static base::Result<Buckets> sort(const SourceSpool& source, const SourceInfo& info, const SourceLattice& lattice,
                                    const std::string& directory, const BucketOptions& options);
  /// Returns the tables to store beside the file, with which open() opens the buckets again.
  base::Bytes encodeTables() const;
  static base::Result<Buckets> open(const std::string& directory, base::ByteView state);

  std::size_t count() const { return extents_.size(); }
  std::uint64_t triangles(std::size_t bucket) const { return counts_[bucket]; }
  const BucketCounts& totals() const { return totals_; }
  const BorderVertices& border() const { return border_; }
  bool hasColors() const { return packing_.has_colors; }
  bool hasNormals() const { return packing_.has_normals; }
  const Winding& winding() const { return winding_; }

  /// 3 corners per triangle, in the source's order, with each connected part wound alike. No triangle is another one
  /// turned over.
  base::Result<std::vector<Corner>> read(std::size_t bucket) const;
  struct NumberedBucket {
    std::vector<Corner> corners;
    NumberedCorners mesh;
  };
  /// The same with its vertices numbered. The bucket of a mesh that has only one is kept in memory for the first call,
  /// so that only one call may run at a time.
  base::Result<NumberedBucket> readNumbered(std::size_t bucket) const;
  /// The same, but `mesh` is empty unless the bucket was kept in memory.
  base::Result<NumberedBucket> readKept(std::size_t bucket) const;
  /// Whether the source has textures that are kept.
  bool hasTextures() const { return packing_.has_sources; }
  /// The number in the source of each triangle that read() gives; kNoSource for one that closes a hole. Only where
  /// textures are kept.
  base::Result<std::vector<std::uint64_t>> sources(std::size_t bucket) const;
  /// The triangles with a corner on the border, as read() gives them.
  base::Result<std::vector<BorderTriangle>> borderTriangles(std::size_t bucket) const;
  /// Frees the buckets' disk space; they can no longer be read.
  void release();

 private:
  struct Area {
    std::uint64_t triangles = 0;  // how many have an area
    glm::dvec3 facing{0.0};
  };
  /// A bit per triangle that is to be flipped; empty where none is.
  using Flips = std::vector<bool>;
  struct WindingPass;

  /// Calls body(corners, source) with each triangle of the bucket.
  template <class Body>
  base::Result<void> forEachTriangle(std::size_t bucket, Body&& body) const;
  base::Result<std::vector<Corner>> readUnflipped(std::size_t bucket) const;
  /// The same of a bucket as it was sorted. Triangles that are another one turned over are dropped from it for good.
  /// Safe from several threads that have one mutex.
  base::Result<std::vector<Corner>> readOneSided(std::size_t bucket, std::mutex& mutex);
  base::Result<std::vector<BorderTriangle>> readUnflippedBorder(std::size_t bucket) const;
  /// Adds the edges that only one triangle of their bucket has.
  base::Result<void> findBorderEdges(unsigned threads, BorderEdges& border);
  /// Per vertex its place on the border, or kNotOnBorder.
  std::vector<std::uint32_t> borderPlaces(const NumberedCorners& mesh) const;
  base::Result<void> storeBorder(std::size_t bucket, std::span<const BorderTriangle> triangles);
  void addToBorder(std::span<const BorderTriangle> triangles);
  Flips flipsOf(std::size_t bucket, std::span<const std::uint32_t> part) const;
  base::Result<Flips> measureFlips(std::size_t bucket) const;
  base::Result<void> makeWindingConsistent(base::ResourceLimits limits);
  base::Result<void> checkBucket(std::size_t bucket, WindingPass& pass);
  BucketWinding measureBucket(const NumberedCorners& mesh, std::span<const std::uint32_t> places,
                              WindingPass& pass) const;
  base::Result<void> flipMinorities(WindingPass& pass, unsigned threads);
  static Area areaOf(const NumberedCorners& mesh);
  base::Error damaged() const;

  friend class BucketSorter;
  SpoolFile file_;
  BucketPacking packing_;
  std::vector<std::vector<Extent>> extents_;
  std::vector<std::uint64_t> counts_;
  BucketCounts totals_;
  BorderVertices border_;
  std::vector<Extent> border_extents_;  // by bucket: where its BorderTriangles lie
  Winding winding_;
  std::vector<Flips> flips_;                    // by bucket, in the run that measured them; else empty
  std::vector<Area> areas_;                     // by bucket, until they are summed
  mutable std::optional<NumberedBucket> kept_;  // the only bucket, until it is read
};

}  // namespace lod::ingest
