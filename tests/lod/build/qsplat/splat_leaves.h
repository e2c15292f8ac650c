#pragma once
// The leaves that a mesh has, as the builder makes them, bucket by bucket.
#include <gtest/gtest.h>

#include "lod/build/qsplat/mesh_leaves.h"
#include "lod/build/source_import.h"
#include "tests/support/temporary_directory.h"

namespace support {

struct MeshSplats {
  lod::build::SourceLattice lattice;
  std::vector<lod::build::qsplat::Splat> leaves;
  lod::build::Mesh sorted;  ///< the triangles that the leaves are made of: repaired, turned to one side, on the lattice
  std::size_t buckets = 0;
};

/// Adds a bucket's corners, three a triangle.
inline void addCorners(std::span<const lod::build::Corner> corners, const lod::build::SourceLattice& lattice,
                       lod::build::Mesh& mesh) {
  for (const lod::build::Corner& corner : corners) {
    mesh.indices.push_back(static_cast<std::uint32_t>(mesh.positions.size()));
    mesh.positions.push_back(lattice.lattice.position(lod::build::mortonPoint(corner.code)));
  }
}

/// `dice`: as in BuildOptions.
inline MeshSplats splatsOf(const lod::build::Mesh& mesh, double dice = 0.0) {
  using namespace lod::build;
  const TemporaryDirectory scratch;
  MeshSplats out;
  auto directory = WorkDirectory::open(scratch.path(), {});
  const auto input = sourceFromMesh(mesh);
  const auto source = importSource(*directory, *input, 2);
  EXPECT_TRUE(source);
  out.lattice = makeLattice(source->info, source->origin, 0);
  const auto buckets = sortSource(*directory, *source, out.lattice, {std::uint64_t{64} << 20, 1, {}});
  EXPECT_TRUE(buckets);
  qsplat::MeshLeaves leaves(*buckets, out.lattice, dice);
  EXPECT_TRUE(leaves.measureBorder(1, {}));
  out.buckets = buckets->count();
  out.sorted.origin = source->origin;
  for (std::size_t b = 0; b < buckets->count(); ++b) {
    auto some = leaves.leaves(b);
    EXPECT_TRUE(some);
    out.leaves.insert(out.leaves.end(), some->splats.begin(), some->splats.end());
    const auto corners = buckets->read(b);
    EXPECT_TRUE(corners);
    addCorners(*corners, out.lattice, out.sorted);
  }
  return out;
}

}  // namespace support
