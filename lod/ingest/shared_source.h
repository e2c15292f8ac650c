#pragma once
// The source of several methods that are built one after the other: read once, and sorted once for those that sort it
// alike. It has a work directory of its own, so that a build that was stopped goes on from there whichever method it
// was at.
#include <mutex>
#include <optional>
#include <string>

#include "lod/ingest/staged_build.h"

namespace lod::ingest {

struct SharedSourceOptions {
  std::string work_directory;
  ResumeKey resume_key;  ///< as StagedBuildOptions has it; not empty
  StitchOptions stitch;  ///< and what follows: how triangles are sorted
  std::uint32_t position_bits = 0;
  bool keeps_textures = false;
  /// How many methods will still ask for the vertices and triangles as they were read, and for those sorted. What none
  /// waits for is removed.
  unsigned spool_users = 0, bucket_users = 0;
};

/// For one build at a time; its functions are called by that build's StagedBuild alone, apart from remove().
class SharedSource {
 public:
  explicit SharedSource(SharedSourceOptions options) : options_(std::move(options)) {}

  /// Goes through Stage::kSpooled, or returns what an earlier build or run left of it. Errors: those of
  /// ingest::importSource, kBusy.
  base::Result<ImportedSource> importSource(const SourceInput& input, unsigned threads);
  /// Whether `source`, which was read for a method that welcomes points, will do for one with such an input.
  static bool serves(const SourceInput& input, const ImportedSource& source) {
    return input.points || source.info.triangles > 0;
  }
  base::Result<SourceSpool> openSpool(const ImportedSource& source);
  /// One method has all that it needs of the spool.
  void leaveSpool();

  /// Whether the triangles are sorted as a method wants them.
  bool sortsAs(const StitchOptions& stitch, std::uint32_t position_bits) const;
  /// Goes through Stage::kSorted, or opens the buckets again. `reads`: not only their tables are wanted. Errors: those
  /// of sortSpool, damaged work files where the buckets are gone.
  base::Result<Buckets> sortTriangles(const ImportedSource& source, const SourceLattice& lattice, BucketOptions options,
                                      bool reads);
  /// One method has all that it needs of the buckets.
  void leaveBuckets(Buckets& buckets);

  const std::string& path() const { return options_.work_directory; }
  /// Removes all work files. A build that asks again reads the source again.
  void remove();
  /// Removes what an earlier run left there, unless somebody uses it.
  static void remove(const std::string& work_directory);

 private:
  base::Result<void> open();
  void removeSpoolIfUnused();

  SharedSourceOptions options_;
  std::optional<WorkDirectory> directory_;
  std::optional<ImportedSource> source_;
  std::mutex mutex_;  // of what follows and of the counts of users, since the threads that store stages leave, too
  bool is_sorted_ = false;  // the buckets are on disk
};

}  // namespace lod::ingest
