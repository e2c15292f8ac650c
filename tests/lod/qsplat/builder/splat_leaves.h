#pragma once
// Makes the leaves of a mesh bucket by bucket, as the builder does.
#include <gtest/gtest.h>

#include "lod/ingest/staged_build.h"
#include "lod/qsplat/builder/mesh_leaves.h"
#include "tests/support/ply_file.h"
#include "tests/support/sorted_mesh.h"
#include "tests/support/temporary_directory.h"

namespace support {

struct MeshSplats {
  lod::ingest::SourceLattice lattice;
  std::vector<lod::qsplat::builder::Splat> leaves;
  lod::qsplat::builder::LeafFacets facets;  ///< around them
  Mesh sorted;  ///< the triangles that the leaves are made of: on the lattice, and wound alike
  std::size_t buckets = 0;
};

/// Adds a bucket's corners, three for each triangle.
inline void addCorners(std::span<const lod::ingest::Corner> corners, const lod::ingest::SourceLattice& lattice,
                       Mesh& mesh) {
  for (const lod::ingest::Corner& corner : corners) {
    mesh.indices.push_back(static_cast<std::uint32_t>(mesh.positions.size()));
    mesh.positions.push_back(lattice.lattice.position(lod::ingest::mortonPoint(corner.code)));
  }
}

/// Adds the facets of another bucket's leaves.
inline void addFacets(const lod::qsplat::builder::LeafFacets& more, std::size_t leaves_before, std::size_t leaves,
                      lod::qsplat::builder::LeafFacets& facets) {
  facets.first.resize(leaves_before + leaves + 1, static_cast<std::uint32_t>(facets.normals.size()));
  for (std::size_t i = 0; !more.empty() && i <= leaves; ++i)
    facets.first[leaves_before + i] = static_cast<std::uint32_t>(facets.normals.size()) + more.first[i];
  facets.normals.insert(facets.normals.end(), more.normals.begin(), more.normals.end());
}

/// `dice` is that of BuildOptions.
inline MeshSplats splatsOf(const Mesh& mesh, double dice = 0.0) {
  using namespace lod::ingest;
  using namespace lod::qsplat::builder;
  const TemporaryDirectory scratch;
  MeshSplats out;
  auto directory = WorkDirectory::open(scratch.path(), {});
  writePly(scratch / "mesh.ply", mesh);
  const auto input = sourceFromFiles({scratch / "mesh.ply"}, {}, 2);
  const auto source = importSource(*directory, *input, 2);
  EXPECT_TRUE(source);
  out.lattice = makeLattice(source->info, source->origin, 0);
  const auto buckets =
      sortImported(*directory, *source, out.lattice, {{1, std::uint64_t{64} << 20}, {.on = false}, {}, false});
  EXPECT_TRUE(buckets);
  MeshLeaves leaves(*buckets, out.lattice, dice);
  EXPECT_TRUE(leaves.measureBorder(1, {}));
  out.buckets = buckets->count();
  out.sorted.origin = source->origin;
  for (std::size_t b = 0; b < buckets->count(); ++b) {
    auto some = leaves.leaves(b);
    EXPECT_TRUE(some);
    addFacets(some->facets, out.leaves.size(), some->splats.size(), out.facets);
    out.leaves.insert(out.leaves.end(), some->splats.begin(), some->splats.end());
    const auto corners = buckets->read(b);
    EXPECT_TRUE(corners);
    addCorners(*corners, out.lattice, out.sorted);
  }
  return out;
}

}  // namespace support
