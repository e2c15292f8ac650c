#include "client/source/static_source.h"

#include <algorithm>

#include "lod/patch/format.h"
#include "repository/faces/face_value.h"

namespace client {

// ---- answers of the fetcher ----

void StaticSource::acceptFailure(const RangeArrival& arrival) {
  const std::string why = describeFailure(arrival.answer, scene_.place + "/" + arrival.wish.object);
  if (isTransient(arrival.answer)) {
    last_failure_ = why;
    retry_set_ = true;
    return;
  }
  const FetchOutcome outcome = arrival.answer.outcome;
  const bool of_one_pack =
      outcome == FetchOutcome::kNotFound || outcome == FetchOutcome::kForbidden || outcome == FetchOutcome::kTooShort;
  if (arrival.wish.kind == kFace && of_one_pack) return loseObject(arrival.wish.object, why);
  fail(why);
}

void StaticSource::acceptArrival(RangeArrival&& arrival) {
  if (arrival.answer.outcome != FetchOutcome::kBytes) return acceptFailure(arrival);
  succeeded_ = true;
  if (arrival.wish.kind == kBlock)
    return acceptBlock(static_cast<std::uint32_t>(arrival.wish.key), arrival.answer.bytes);
  if (arrival.wish.kind == kChunk)
    return acceptChunk(static_cast<std::uint32_t>(arrival.wish.key), arrival.answer.bytes);
  if (arrival.wish.kind == kOpening) {
    opening_.emplace(arrival.wish.key, std::move(arrival.answer.bytes));
    return;
  }
  if (arrival.wish.kind == kIndexBlock) return acceptIndexBlock(arrival.wish.key, arrival.answer.bytes);
  if (arrival.wish.kind == kFace) {
    if (const auto key = FaceKey::fromCode(arrival.wish.key)) acceptFace(*key, std::move(arrival.answer.bytes));
    return;
  }
  if (auto taken = acceptTable(arrival); !taken)
    fail(scene_.place + "/" + arrival.wish.object + ": " + taken.error().message);
}

base::Result<void> StaticSource::acceptTable(const RangeArrival& arrival) {
  return arrival.wish.kind == kRecordFront ? acceptRecordFront(arrival.answer.bytes)
                                           : acceptIndexFront(arrival.answer.bytes);
}

base::Result<void> StaticSource::acceptRecordFront(base::ByteView bytes) {
  LUMIGRID_ASSIGN_OR_RETURN(auto read, GroupRecords::open(bytes));
  const lod::patch::RecordCounts& counts = read.counts();
  if (counts.object_bytes != scene_.records.bytes || counts.patch_bytes != scene_.patches.bytes)
    return badScene("is not as long as scene.json says, or of another hierarchy");
  if (counts.groups > protocol::kMaxGroups || counts.patches > protocol::kMaxPatches)
    return badScene("has more groups than a client takes");
  stats_.record_bytes += bytes.size();
  hierarchy_.lattice = counts.lattice;
  hierarchy_.has_colors = counts.has_colors;
  hierarchy_.source_triangles = counts.source_triangles;
  has_group_.assign(counts.groups, false);

  // Groups are numbered from the top down, so the records that are here belong to the coarsest groups.
  lod::patch::Hierarchy rows;
  for (std::uint32_t g = 0; g < read.leadingGroups(); ++g) rows.groups.push_back(*read.row(g));
  if (rows.groups.empty()) rows.groups.resize(1);
  coarse_ = plan::coarseGroups(rows, plan::kCoarseBytes);
  records_ = std::move(read);
  return {};
}

base::Result<void> StaticSource::acceptIndexFront(base::ByteView bytes) {
  LUMIGRID_ASSIGN_OR_RETURN(auto decoded, repository::decodeIndexRoot(bytes));
  if (decoded.object_bytes != scene_.index->bytes) return badScene("is not as long as scene.json says");
  if (decoded.frontBytes() != bytes.size()) return badScene("has a front of another length than scene.json says");
  stats_.index_bytes += bytes.size();
  const base::ByteView text = bytes.subspan(repository::parameterOffset(), decoded.parameter_bytes);
  LUMIGRID_TRY(repository::checkParameters(decoded, text));
  LUMIGRID_ASSIGN_OR_RETURN(auto read, read_parameters_(std::string(text.begin(), text.end())));
  points_ = std::move(read);
  root_ = std::move(decoded);
  return {};
}

/// The groups of a damaged chunk are left out, and what is drawn in their place stays.
void StaticSource::acceptChunk(std::uint32_t chunk, base::ByteView bytes) {
  stats_.record_bytes += bytes.size();
  if (auto taken = records_->add(chunk, bytes); !taken) {
    const std::uint32_t first = chunk * GroupRecords::kGroupsPerChunk;
    const std::uint32_t end = std::min(first + GroupRecords::kGroupsPerChunk, records_->counts().groups);
    for (std::uint32_t group = first; group < end; ++group) loseGroup(group, taken.error().message);
  }
  replan_ = pick_data_arrived_ = true;
}

/// Hands a block to the session.
void StaticSource::acceptBlock(std::uint32_t group, base::ByteView bytes) {
  const base::ByteView record = records_->record(group);
  if (record.empty() || has_group_[group]) return;
  base::Bytes block(bytes.begin(), bytes.end());
  has_group_[group] = true;
  picks_.keepBlock(group, block);
  pick_data_arrived_ = true;
  keepCoarseBlock(group, block);
  outgoing_.push_back(
      {protocol::encode(protocol::Refinement{base::Bytes(record.begin(), record.end()), std::move(block)}), {}, group});
}

void StaticSource::keepCoarseBlock(std::uint32_t group, const base::Bytes& block) {
  if (sight_computed_ || !scene_.index) return;
  coarse_blocks_.resize(coarse_.size());
  const auto at = static_cast<std::size_t>(std::find(coarse_.begin(), coarse_.end(), group) - coarse_.begin());
  if (at < coarse_.size()) coarse_blocks_[at] = block;
}

/// Computes which coarse groups hide which. Where a block is damaged or missing, images are chosen as if nothing were
/// hidden.
void StaticSource::computeSight() {
  if (std::exchange(sight_computed_, true) || coarse_blocks_.empty()) return;
  auto seen = plan::makeCoarseSight(hierarchy_, coarse_, [this](std::uint32_t group) -> base::ByteView {
    return coarse_blocks_[static_cast<std::size_t>(std::find(coarse_.begin(), coarse_.end(), group) - coarse_.begin())];
  });
  if (seen) sight_ = std::move(*seen);
  coarse_blocks_ = {};
}

void StaticSource::acceptIndexBlock(std::uint64_t number, base::ByteView bytes) {
  stats_.index_bytes += bytes.size();
  auto block = repository::decodeIndexBlock(*root_, number, bytes);
  if (!block) {
    broken_index_blocks_.insert(number);
    ++stats_.broken;
    return reportProblem(scene_.place + "/" + scene_.index->name + ": block " + std::to_string(number) + ": " +
                         block.error().message + "; its images are not shown");
  }
  const std::uint64_t taken = block->bytes();
  index_blocks_.insert(number, std::move(*block), taken);
  index_learned_ = true;
  index_blocks_.evict(
      [this, number](std::uint64_t other) { return other == number || index_wanted_.count(other) != 0; });
}

void StaticSource::acceptFace(const FaceKey& key, base::Bytes bytes) {
  if (has_face_.count(key) != 0) return;
  if (bytes.size() > protocol::kMaxPayload || !repository::decodeFaceValue(bytes)) {
    gone_.insert(key);
    ++stats_.broken;
    return reportProblem(scene_.place +
                         ": an image is damaged; publish the scene again with `lumigrid publish --rewrite`");
  }
  has_face_.insert(key);
  image_bytes_.add(bytes.size());
  outgoing_.push_back({protocol::encode(protocol::Face{key, std::move(bytes)}), key, {}});
}

}  // namespace client
