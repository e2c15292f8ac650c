#pragma once
// The part of a build that all methods share: limits, work directory, progress, and the stages that read and sort the
// source.
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/resource_limits.h"
#include "base/stopwatch.h"
#include "lod/ingest/source_import.h"

namespace lod::ingest {

class StagedBuild {
 public:
  /// `name` completes "building the … was cancelled". `progress` must outlive it; it may be empty.
  StagedBuild(std::string name, base::ResourceLimits limits, std::string output_path, const Progress& progress)
      : name_(std::move(name)), limits_(limits.resolved()), output_path_(std::move(output_path)), progress_(progress) {}

  /// Checks that there is enough memory and descriptors, opens the work directory (empty: beside the output), runs
  /// `stages` and removes it again, unless they failed and a rerun under the same key can go on. Errors: kNoSpace,
  /// those of opening it, and those of the stages.
  base::Result<void> run(const std::string& work_directory, const ResumeKey& key,
                         const std::function<base::Result<void>()>& stages);

  /// Goes through Stage::kSpooled and chooses the lattice. `position_bits`: as in makeLattice.
  base::Result<void> importSource(const SourceInput& input, std::uint32_t position_bits);
  /// Goes through Stage::kSorted for triangles.
  base::Result<Buckets> sortTriangles();

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
  base::ResourceLimits limits_;
  std::string output_path_;
  const Progress& progress_;
  std::mutex progress_mutex_;
  const base::Stopwatch watch_;
  double import_seconds_ = 0.0;
  std::optional<WorkDirectory> directory_;
  ImportedSource source_;
  SourceLattice lattice_;
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
