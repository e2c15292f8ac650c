#pragma once
// How every build begins: the source's files spooled to the work directory and measured, and the scene's origin, which
// is the same for all methods.
#include <functional>
#include <string>
#include <vector>

#include "lod/ingest/buckets.h"
#include "lod/ingest/repair_counts.h"
#include "lod/ingest/source_spool.h"
#include "lod/ingest/work_directory.h"

namespace lod::ingest {

/// Stage name, 0..1 done. Return false to cancel. Called from worker threads too, but never from two at once.
using Progress = std::function<bool(const std::string& stage, double done)>;

/// Where a build's vertices and triangles come from.
struct SourceInput {
  /// Fills the spool, and adds to `notes` what concerns the files (warnings, short_faces).
  std::function<base::Result<void>(SourceSpool& spool, SourceInfo& notes)> read;
  std::uint64_t bytes = 0;  ///< that the spool takes, about
  bool points = false;      ///< vertices without any triangle are a source too
};
/// With one thread, reading a file and spooling what was read take turns. `points`: files without faces are welcome.
/// Error: no file is named.
base::Result<SourceInput> sourceFromFiles(const std::vector<std::string>& paths, const Progress& progress,
                                          unsigned threads, bool points = false);

/// What a build is going to take, told once the source has been read. Figures are rough: measured on other scans.
struct BuildPlan {
  std::uint64_t triangles = 0;  ///< 0: points
  std::uint64_t vertices = 0;   ///< in use
  std::uint64_t output_bytes = 0;
  std::uint64_t work_bytes = 0;  ///< at most, in the work directory
  double seconds = 0.0;          ///< on the threads given
};

/// What every build tells of its source.
struct SourceSummary {
  RepairCounts repairs;
  std::uint64_t triangles = 0;  ///< of the leaves; 0: the source is points
  glm::dvec3 origin{0.0};       ///< the scene's, world
  glm::dvec3 box_min{0.0};      ///< world
  glm::dvec3 box_max{0.0};
  glm::dvec3 facing{0.0};  ///< sum of all normals, by area: which side an open scan shows
  bool has_colors = false;
  std::vector<std::string> warnings;
  double import_seconds = 0.0;  ///< of seconds: reading the sources
  double seconds = 0.0;
  double cpu_seconds = 0.0;
  std::uint64_t bytes = 0;  ///< of the file built
};

struct ImportedSource {
  SourceInfo info;
  glm::dvec3 origin{0.0};
  std::uint64_t vertex_bytes = 0;  ///< of the spool
  std::uint64_t triangle_bytes = 0;
};
/// Stage 1 of the work directory: done, or as an earlier run left it. Errors: those of reading, kNoSpace, kIo.
base::Result<ImportedSource> importSource(WorkDirectory& directory, const SourceInput& input, unsigned threads);
/// The spool that importSource left. Errors: kIo, damaged work files.
base::Result<SourceSpool> openSource(const WorkDirectory& directory, const ImportedSource& source);

/// Stage 2: the triangles in buckets, the spool gone; done, or as an earlier run left it. Errors:
/// those of Buckets::sort, kNoSpace, damaged work files.
base::Result<Buckets> sortSource(WorkDirectory& directory, const ImportedSource& source, const SourceLattice& lattice,
                                 const BucketOptions& options);

/// What reading and sorting put right, added to `repairs`.
void addRepairs(const ImportedSource& source, const Buckets& buckets, RepairCounts& repairs);

/// The error with the first file's name before it where it is about the mesh and names none.
base::Error ofSource(const std::vector<std::string>& paths, base::Error error);

}  // namespace lod::ingest
