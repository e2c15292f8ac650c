#pragma once
// The part of a build that all methods share: limits, work directory, progress, and the first stages, in which the
// source's files are spooled to the work directory and measured, and their triangles sorted into buckets. All methods
// choose the same origin for the scene.
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/resource_limits.h"
#include "base/stopwatch.h"
#include "lod/ingest/buckets.h"
#include "lod/ingest/source_spool.h"
#include "lod/ingest/work_directory.h"

namespace lod::ingest {

/// Gets a stage's name and the share of it that is done, and returns false to cancel. It is called from any thread, but
/// never from two at once.
using Progress = std::function<bool(const std::string& stage, double done)>;

/// The source files of a build.
struct SourceInput {
  /// Fills the spool, and adds the files' georeference, warnings and short_faces to `notes`.
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

class SharedSource;

/// The options of a build that are the same for all methods. The output depends on the first alone.
struct StagedBuildOptions {
  /// Lattice steps along the longest side of a mesh as a power of two, 10 … 21; 0: chosen as makeLattice says.
  std::uint32_t position_bits = 0;
  base::ResourceLimits limits;
  std::string work_directory;  ///< for the work files; empty: beside the output
  /// Gives what decides the output besides the method's own options (the sources' checksums). A work directory that an
  /// earlier run left under the same key is continued; empty: every build starts afresh.
  ResumeKey resume_key;
  /// Reads and sorts the source for this build and for others after it, and must outlive it; null: the build does that
  /// for itself.
  SharedSource* shared = nullptr;
  std::function<void(const BuildPlan&)> on_plan;  ///< may be empty
  /// May be empty; called when the output is in its place, before work files are removed.
  std::function<void()> on_written;
};

/// How often each repair was made. Names are stable, since `info --json` shows them: "welded_vertices",
/// "degenerate_triangles", "duplicate_triangles", "two_sided_triangles" (another one turned over),
/// "lattice_collapsed_triangles", "flipped_triangles", "non_orientable_parts", "unreferenced_vertices",
/// "stitched_vertices", "split_border_edges", "closed_holes", "added_triangles".
struct RepairCounts {
  std::map<std::string, std::uint64_t> counts;

  void add(const std::string& repair, std::uint64_t times) {
    if (times > 0) counts[repair] += times;
  }
};

/// The source's border, and what stitching did to it.
struct BorderSummary {
  std::uint64_t source_open_edges = 0;  ///< edges of only one triangle
  std::uint64_t open_edges = 0;         ///< the same, after stitching
  double largest_movement = 0.0;        ///< of a stitched place, scene units
};

/// The part of a build's summary that is the same for all methods.
struct SourceSummary {
  RepairCounts repairs;
  BorderSummary border;         ///< all 0 where the source is points
  std::uint64_t triangles = 0;  ///< in the leaves; 0 where the source is points
  glm::dvec3 origin{0.0};       ///< the scene's, world
  glm::dvec3 box_min{0.0};      ///< world
  glm::dvec3 box_max{0.0};
  glm::dvec3 facing{0.0};  ///< sum of all normals by area: the side that an open scan shows
  bool has_colors = false;
  bool is_painted = false;  ///< as SourceInfo has it
  mesh::Georeference georeference;
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

/// Goes through Stage::kSorted in a directory that need not be the spool's, or opens the buckets that an earlier run
/// left. `leave` is called once the spool is no longer wanted. Errors: those of Buckets::sort and of `open`, kNoSpace,
/// damaged work files.
base::Result<Buckets> sortSpool(WorkDirectory& directory, const std::function<base::Result<SourceSpool>()>& open,
                                std::function<void()> leave, const SourceInfo& info, const SourceLattice& lattice,
                                const BucketOptions& options);

/// A line that says that more than a hundredth of the triangles are lost since their vertices fall together, and what
/// to do; empty where fewer are. `collapsed`: how many.
std::string lostTriangles(const SourceInfo& info, const SourceLattice& lattice, std::uint64_t collapsed);

/// A line that says that edges are so short for the mesh's box that the finest lattice changes shapes, and what to do;
/// empty where it does not.
std::string roundedShapes(const SourceInfo& info, const SourceLattice& lattice);

/// The line of lostTriangles for a source of points, of which so many became one with another; empty for meshes.
std::string lostPoints(const SourceInfo& info, const SourceLattice& lattice, std::uint64_t merged);

/// Adds the repairs of reading and sorting to the summary, with warnings where stitching was left out, and of
/// lostTriangles or roundedShapes.
void addRepairs(const ImportedSource& source, const Buckets& buckets, const SourceLattice& lattice,
                SourceSummary& summary);

/// Puts the first file's name before an error about the mesh that names no file.
base::Error namingSource(const std::vector<std::string>& paths, base::Error error);

/// Begins the keys of all builds: the format of what the first stages leave.
inline constexpr const char* kImportFormat = "import 2 ";
/// A key whose text is `prefix` and then `key`'s; empty where `key` is.
ResumeKey withPrefix(std::string prefix, ResumeKey key);

class StagedBuild {
 public:
  /// `name` completes "building the … was cancelled". `progress` must outlive it; it may be empty.
  StagedBuild(std::string name, StagedBuildOptions options, std::string output_path, const Progress& progress)
      : name_(std::move(name)),
        options_(std::move(options)),
        limits_(options_.limits.resolved()),
        output_path_(std::move(output_path)),
        progress_(progress) {}

  /// Checks that there is enough memory and descriptors, opens the work directory, runs `stages` and removes it
  /// again, unless they failed and a rerun under the same key can go on. `key_prefix` holds all options of the method
  /// that decide the output. Errors: kNoSpace, those of opening it, and those of the stages.
  base::Result<void> run(const std::string& key_prefix, const std::function<base::Result<void>()>& stages);

  /// Goes through Stage::kSpooled and chooses the lattice. `position_bits`: as in StagedBuildOptions.
  base::Result<void> importSource(const SourceInput& input, std::uint32_t position_bits);
  /// Calls on_plan, once the source is imported. The plan's time is estimated from `items`, of which each core makes
  /// `items_per_core_second`.
  void reportPlan(std::uint64_t output_bytes, std::uint64_t work_bytes, std::uint64_t items,
                  double items_per_core_second) const;
  /// The vertices and triangles as they were read. Errors: kIo, damaged work files.
  base::Result<SourceSpool> openSpool();
  /// Returns a function to call once that is no longer wanted; the last user removes it. Safe from any thread.
  std::function<void()> spoolLeaver();
  struct SortOptions {
    StitchOptions stitch;
    /// The method does more with textures than to colour vertices, so that no warning is due.
    bool keeps_textures = false;
    /// The stage of this directory behind which the buckets are not read any more. Without one they are never shared.
    std::optional<Stage> read_until;
  };
  /// Goes through Stage::kSorted for triangles. The resume key must tell how they are stitched.
  base::Result<Buckets> sortTriangles(const SortOptions& options);
  /// Says that the buckets are no longer wanted: the last who uses them releases them. Safe from any thread.
  void leaveBuckets(Buckets& buckets);
  /// Where importSource() left the units of pictures.
  const std::string& sourceDirectory() const;
  /// Where sortTriangles() left the texture places of the buckets.
  const std::string& bucketDirectory() const;

  /// Reports progress; false cancels. Safe from several threads.
  bool report(const std::string& stage, double done);
  base::Error cancelled() const { return {base::ErrorCode::kCancelled, "building the " + name_ + " was cancelled"}; }

  /// Fills in all that importSource() measured, and the times so far.
  void summarize(SourceSummary& summary) const;

  WorkDirectory& directory() { return *directory_; }
  const std::string& outputPath() const { return output_path_; }
  const ImportedSource& source() const { return source_; }
  const SourceLattice& lattice() const { return lattice_; }
  unsigned threads() const { return limits_.threads; }
  /// Memory of the whole process.
  std::uint64_t memoryBytes() const { return limits_.memory_bytes; }
  /// Memory for what is worked on: code, stacks and small tables take the rest.
  std::uint64_t workMemory() const { return limits_.memory_bytes - kMinMemory / 2; }

 private:
  std::string name_;
  StagedBuildOptions options_;
  base::ResourceLimits limits_;
  std::string output_path_;
  const Progress& progress_;
  std::mutex progress_mutex_;
  const base::Stopwatch watch_;
  double import_seconds_ = 0.0;
  std::optional<WorkDirectory> directory_;
  ImportedSource source_;
  SourceLattice lattice_;
  bool shares_source_ = false;   // the spool is options_.shared's
  bool shares_buckets_ = false;  // the buckets are
  bool keeps_textures_ = false;
};

/// Runs `build` on the files' source, and once more from the start where it finds its work files damaged. Puts a file's
/// name before errors about the mesh.
template <class Build>
auto buildFromSource(const std::vector<std::string>& paths, const SourceInput& input, const Build& build) {
  auto summary = build(input);
  // The damaged work files have been removed by now.
  if (!summary && isDamageError(summary.error())) summary = build(input);
  if (!summary) summary = namingSource(paths, summary.error());
  return summary;
}

}  // namespace lod::ingest
