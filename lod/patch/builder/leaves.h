#pragma once
// A bucket of triangles becomes leaf patches: duplicates out, attributes averaged at each lattice point, voxels, METIS
// (Okamoto 2011, section 4.1, steps 1 and 2).
//
// Leaf patches do not cross bucket borders. The paper partitions one graph of all voxels; here the graph is a bucket's,
// so that memory does not grow with the mesh. The next level's groups cross bucket borders like any other.
#include "base/error.h"
#include "lod/ingest/buckets.h"
#include "lod/patch/builder/patch_split.h"

namespace lod::patch::builder {

struct LeafOptions {
  std::uint32_t voxel_triangles = 500;
  std::uint32_t leaf_triangles = 4000;
};

struct BucketLeaves {
  std::vector<NewPatch> patches;
  std::uint64_t duplicates = 0;  ///< triangles left out: the same corners, wound alike, again
  std::uint64_t vertices = 0;    ///< used by this bucket
};

/// `bits` as the lattice's. Errors: those of reading the bucket.
base::Result<BucketLeaves> makeLeaves(const ingest::Buckets& buckets, std::size_t bucket,
                                      const ingest::SourceLattice& lattice, const LeafOptions& options);

}  // namespace lod::patch::builder
