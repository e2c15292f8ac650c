#pragma once
// The first stages of every build: the source's files are spooled to the work directory and measured, and their
// triangles sorted into buckets. All methods choose the same origin for the scene.
#include <functional>
#include <string>
#include <vector>

#include "lod/ingest/buckets.h"
#include "lod/ingest/repair_counts.h"
#include "lod/ingest/source_spool.h"
#include "lod/ingest/work_directory.h"

namespace lod::ingest {

/// Gets a stage's name and the share of it that is done, and returns false to cancel. It is called from any thread, but
/// never from two at once.
using Progress = std::function<bool(const std::string& stage, double done)>;

/// The source files of a build.
struct SourceInput {
  /// Fills the spool, and adds the files' warnings and short_faces to `notes`.
  std::function<base::Result<void>(SourceSpool& spool, SourceInfo& notes)> read;
  std::uint64_t bytes = 0;  ///< about what the spool takes
  bool points = false;      ///< a source without any triangle is no error
};
/// With one thread, reading a file and spooling what was read take turns. `points`: files without faces are welcome.
/// Error: no file is named.
base::Result<SourceInput> sourceFromFiles(const std::vector<std::string>& paths, const Progress& progress,
                                          unsigned threads, bool points = false);

/// The disk space and time that a build will take, known once the source has been read. The figures were measured on
/// other scans and are rough.
struct BuildPlan {
  std::uint64_t triangles = 0;  ///< 0: points
  std::uint64_t vertices = 0;   ///< in use
  std::uint64_t output_bytes = 0;
  std::uint64_t work_bytes = 0;  ///< at most, in the work directory
  double seconds = 0.0;          ///< on the threads given
};

/// The part of a build's summary that is the same for all methods.
struct SourceSummary {
  RepairCounts repairs;
  std::uint64_t triangles = 0;  ///< in the leaves; 0 where the source is points
  glm::dvec3 origin{0.0};       ///< the scene's, world
  glm::dvec3 box_min{0.0};      ///< world
  glm::dvec3 box_max{0.0};
  glm::dvec3 facing{0.0};  ///< sum of all normals by area: the side that an open scan shows
  bool has_colors = false;
  std::vector<std::string> warnings;
  double import_seconds = 0.0;  ///< the part of `seconds` for reading the sources
  double seconds = 0.0;
  double cpu_seconds = 0.0;
  std::uint64_t bytes = 0;  ///< length of the built file
};

struct ImportedSource {
  SourceInfo info;
  glm::dvec3 origin{0.0};
  std::uint64_t vertex_bytes = 0;  ///< length in the spool
  std::uint64_t triangle_bytes = 0;
};
/// Goes through Stage::kSpooled, or returns what an earlier run left of it. Errors: those of reading, kNoSpace, kIo.
base::Result<ImportedSource> importSource(WorkDirectory& directory, const SourceInput& input, unsigned threads);
/// The spool that importSource left. Errors: kIo, damaged work files.
base::Result<SourceSpool> openSource(const WorkDirectory& directory, const ImportedSource& source);

/// Goes through Stage::kSorted, or opens the buckets that an earlier run left; the spool is removed. Errors: those of
/// Buckets::sort, kNoSpace, damaged work files.
base::Result<Buckets> sortSource(WorkDirectory& directory, const ImportedSource& source, const SourceLattice& lattice,
                                 const BucketOptions& options);

/// Adds the repairs of reading and sorting to `repairs`.
void addRepairs(const ImportedSource& source, const Buckets& buckets, RepairCounts& repairs);

/// Puts the first file's name before an error about the mesh that names no file.
base::Error namingSource(const std::vector<std::string>& paths, base::Error error);

}  // namespace lod::ingest
