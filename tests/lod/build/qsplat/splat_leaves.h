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
  std::size_t buckets = 0;
};

inline MeshSplats splatsOf(const lod::build::Mesh& mesh) {
  using namespace lod::build;
  const TemporaryDirectory scratch;
  MeshSplats out;
  auto directory = WorkDirectory::open(scratch.path(), "");
  const auto input = sourceFromMesh(mesh);
  const auto source = importSource(*directory, *input, false);
  EXPECT_TRUE(source);
  out.lattice = makeLattice(source->info, source->origin, 0);
  const auto buckets = sortSource(*directory, *source, out.lattice, {std::uint64_t{64} << 20, 1, {}}, false);
  EXPECT_TRUE(buckets);
  qsplat::MeshLeaves leaves(*buckets, out.lattice);
  EXPECT_TRUE(leaves.measureBorder(1, {}));
  out.buckets = buckets->count();
  for (std::size_t b = 0; b < buckets->count(); ++b) {
    auto some = leaves.leaves(b);
    EXPECT_TRUE(some);
    out.leaves.insert(out.leaves.end(), some->begin(), some->end());
  }
  return out;
}

}  // namespace support
