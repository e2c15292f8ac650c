#include "lod/ingest/shared_source.h"

#include <filesystem>
#include <utility>

namespace lod::ingest {

base::Result<void> SharedSource::open() {
  if (directory_) return {};
  // All that decides the work files.
  const std::string prefix = std::string(kImportFormat) + "source " + describeStitch(options_.stitch) + " " +
                             std::to_string(options_.position_bits) + (options_.keeps_textures ? " textures " : " ");
  LUMIGRID_ASSIGN_OR_RETURN(directory_, WorkDirectory::open(path(), withPrefix(prefix, options_.resume_key)));
  is_sorted_ = directory_->isFinished(Stage::kSorted);
  return {};
}

base::Result<ImportedSource> SharedSource::importSource(const SourceInput& input, unsigned threads) {
  if (source_) return *source_;
  LUMIGRID_TRY(open());
  LUMIGRID_ASSIGN_OR_RETURN(source_, ingest::importSource(*directory_, input, threads));
  return *source_;
}

base::Result<SourceSpool> SharedSource::openSpool(const ImportedSource& source) {
  auto spool = ingest::openSource(*directory_, source);
  // It was removed when no method waited for it, and this one came later.
  if (!spool && spool.error().code == base::ErrorCode::kNotFound) return directory_->damaged();
  return spool;
}

void SharedSource::leaveSpool() {
  const std::lock_guard lock(mutex_);
  if (options_.spool_users > 0) --options_.spool_users;
  removeSpoolIfUnused();
}

void SharedSource::removeSpoolIfUnused() {
  if (options_.spool_users > 0 || (options_.bucket_users > 0 && !is_sorted_)) return;
  SourceSpool::remove(path());
}

bool SharedSource::sortsAs(const StitchOptions& stitch, std::uint32_t position_bits) const {
  return options_.bucket_users > 0 && describeStitch(stitch) == describeStitch(options_.stitch) &&
         position_bits == options_.position_bits;
}

base::Result<Buckets> SharedSource::sortTriangles(const ImportedSource& source, const SourceLattice& lattice,
                                                  BucketOptions options, bool reads) {
  if (reads && directory_->isFinished(Stage::kSourceReleased)) return directory_->damaged();
  options.keeps_textures = options_.keeps_textures;
  // Its state is read back where another method has sorted in this run.
  if (directory_->isFinished(Stage::kSorted)) LUMIGRID_TRY(directory_->settle());
  const auto open = [&] { return openSpool(source); };
  const auto leave = [this] {
    const std::lock_guard lock(mutex_);
    is_sorted_ = true;
    removeSpoolIfUnused();
  };
  return sortSpool(*directory_, open, leave, source.info, lattice, options);
}

void SharedSource::leaveBuckets(Buckets& buckets) {
  {
    const std::lock_guard lock(mutex_);
    if (options_.bucket_users > 1) {
      --options_.bucket_users;
      return;
    }
  }
  if (directory_->isFinished(Stage::kSourceReleased)) return;
  // A later run must know before they are gone.
  if (directory_->finishStage(Stage::kSourceReleased, {}, {}) && directory_->settle()) buckets.release();
}

void SharedSource::remove() {
  if (!directory_) return remove(path());
  directory_->abandonStages();
  (void)directory_->settle();
  directory_->remove();
  directory_.reset();
  source_.reset();
}

void SharedSource::remove(const std::string& work_directory) {
  if (!std::filesystem::exists(work_directory)) return;
  if (auto directory = WorkDirectory::open(work_directory, {})) directory->remove();
}

}  // namespace lod::ingest
