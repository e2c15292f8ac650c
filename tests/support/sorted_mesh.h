#pragma once
// A mesh that went through the import of a build: read from a file, laid on the lattice, stitched and sorted.
#include <string>

#include "lod/ingest/staged_build.h"
#include "tests/support/ply_file.h"
#include "tests/support/temporary_directory.h"

namespace support {

/// Sorts what lies imported in the directory, as a build that shares its source with no other.
inline base::Result<lod::ingest::Buckets> sortImported(lod::ingest::WorkDirectory& directory,
                                                       const lod::ingest::ImportedSource& source,
                                                       const lod::ingest::SourceLattice& lattice,
                                                       const lod::ingest::BucketOptions& options) {
  const auto open = [&] { return lod::ingest::openSource(directory, source); };
  return lod::ingest::sortSpool(directory, open, {}, source.info, lattice, options);
}

struct SortedMesh {
  TemporaryDirectory scratch;
  lod::ingest::SourceLattice lattice;
  base::Result<lod::ingest::Buckets> buckets = base::Error{base::ErrorCode::kIo, "not sorted"};

  template <class SomeMesh>
  SortedMesh(const SomeMesh& mesh, std::uint64_t memory, unsigned threads, const lod::ingest::StitchOptions& stitch) {
    using namespace lod::ingest;
    auto directory = WorkDirectory::open(scratch.path(), {});
    writePly(scratch / "mesh.ply", mesh);
    const auto input = sourceFromFiles({scratch / "mesh.ply"}, {}, 2);
    const auto source = importSource(*directory, *input, 2);
    lattice = makeLattice(source->info, source->origin, 0);
    buckets = sortImported(*directory, *source, lattice, {{threads, memory}, stitch, {}, false});
  }
};

}  // namespace support
