#include "lod/ingest/staged_build.h"

namespace lod::ingest {
namespace {

// Work files, the output, the lock, and what the library opens meanwhile: a choice, with room to spare.
constexpr std::uint64_t kDescriptors = 32;

}  // namespace

base::Result<void> StagedBuild::run(const std::string& work_directory, const ResumeKey& key,
                                    const std::function<base::Result<void>()>& stages) {
  LUMIGRID_TRY(needMemory(limits_.memory_bytes));
  LUMIGRID_TRY(needDescriptors(kDescriptors));
  return runStages(directory_, work_directory, key, output_path_, stages);
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
