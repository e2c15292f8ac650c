#include "lod/ingest/staged_build.h"

#include <sys/resource.h>

#include "base/text.h"

namespace lod::ingest {
namespace {

using base::Error;
using base::ErrorCode;

// Work files, the output, the lock, and what the library opens meanwhile: a choice, with room to spare.
constexpr std::uint64_t kDescriptors = 32;

// kNoSpace when less than kMinMemory is given.
base::Result<void> needMemory(std::uint64_t bytes) {
  if (bytes >= kMinMemory) return {};
  return Error{ErrorCode::kNoSpace, "the memory given, " + base::formatBytes(bytes) +
                                        ", is too small: building needs " + base::formatBytes(kMinMemory) +
                                        " at least (--memory)"};
}

// kNoSpace when this process may not have so many files open.
base::Result<void> needDescriptors() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur >= kDescriptors) return {};
  return Error{ErrorCode::kNoSpace, "this process may have " + std::to_string(limit.rlim_cur) +
                                        " files open, building needs " + std::to_string(kDescriptors) +
                                        "; raise the limit (ulimit -n) and build again"};
}

// Whether a rerun can succeed: an error in the source stays.
bool canResume(const base::Error& error) {
  return error.code == ErrorCode::kCancelled || error.code == ErrorCode::kNoSpace || error.code == ErrorCode::kIo;
}

}  // namespace

base::Result<void> StagedBuild::run(const std::string& work_directory, const ResumeKey& key,
                                    const std::function<base::Result<void>()>& stages) {
  LUMIGRID_TRY(needMemory(limits_.memory_bytes));
  LUMIGRID_TRY(needDescriptors());
  LUMIGRID_ASSIGN_OR_RETURN(directory_,
                            WorkDirectory::open(work_directory.empty() ? output_path_ + ".work" : work_directory, key));
  base::removeUnfinished(output_path_);  // the lock makes sure that no other build is writing it
  auto done = stages();
  // A complete output needs no work files, whole or damaged.
  if (done) directory_->abandonStages();
  (void)directory_->settle();
  if (done || !key || !canResume(done.error())) directory_->remove();
  return done;
}

base::Result<void> StagedBuild::importSource(const SourceInput& input, std::uint32_t position_bits) {
  if (!directory_->isFinished(Stage::kSpooled) && !report("import", 0.0)) return cancelled();
  LUMIGRID_ASSIGN_OR_RETURN(source_, ingest::importSource(*directory_, input, limits_.threads));
  // Points of a cloud are closer together than the ends of a mesh's edges, and no edge tells how close.
  const bool points = source_.info.triangles == 0;
  lattice_ = makeLattice(source_.info, source_.origin, points ? kMaxLatticeBits : position_bits);
  import_seconds_ = watch_.seconds();
  return {};
}

base::Result<Buckets> StagedBuild::sortTriangles() {
  if (!directory_->isFinished(Stage::kSorted) && !report("sort", 0.0)) return cancelled();
  const BucketOptions options{{limits_.threads, workMemory() / 2},
                              [this](double done) { return report("sort", done); }};
  return sortSource(*directory_, source_, lattice_, options);
}

bool StagedBuild::report(const std::string& stage, double done) {
  const std::lock_guard lock(progress_mutex_);
  return !progress_ || progress_(stage, done);
}

void StagedBuild::summarize(SourceSummary& summary) const {
  summary.origin = source_.origin;
  summary.box_min = source_.info.box_min;
  summary.box_max = source_.info.box_max;
  summary.has_colors = source_.info.has_colors;
  summary.warnings = source_.info.warnings;
  summary.import_seconds = import_seconds_;
  summary.seconds = watch_.seconds();
  summary.cpu_seconds = watch_.cpuSeconds();
}

}  // namespace lod::ingest
