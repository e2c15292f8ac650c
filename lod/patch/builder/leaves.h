#pragma once
// Makes leaf patches of a bucket of triangles: drops duplicates, averages attributes at each lattice point, and
// partitions the graph of voxels (Okamoto 2011, section 4.1, steps 1 and 2).
//
// Leaf patches do not cross bucket borders. The paper partitions one graph of all voxels; here each bucket has its own,
// so that memory does not grow with the mesh. The groups of the next level cross bucket borders like any other.
#include "base/error.h"
#include "lod/ingest/buckets.h"
#include "lod/patch/builder/hierarchy_build.h"
#include "lod/patch/builder/patch_split.h"

namespace lod::patch::builder {

struct BucketLeaves {
  std::vector<NewPatch> patches;
  std::uint64_t duplicates = 0;  ///< triangles left out, since one with the same corners and winding is there
  std::uint64_t vertices = 0;    ///< used by this bucket
};

/// Errors: those of reading the bucket.
base::Result<BucketLeaves> makeLeaves(const ingest::Buckets& buckets, std::size_t bucket,
                                      const ingest::SourceLattice& lattice, const HierarchyOptions& options);

}  // namespace lod::patch::builder
