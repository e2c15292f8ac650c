#include <algorithm>

#include "client/source/static_source_impl.h"
#include "lod/patch/format.h"
#include "repository/faces/face_value.h"

namespace client {

// ---- answers of the fetcher ----

void StaticSource::Impl::acceptFailure(const RangeArrival& arrival) {
  const std::string why = describeFailure(arrival.answer, scene.place + "/" + arrival.wish.object);
  if (isTransient(arrival.answer)) {
    last_failure = why;
    retry_set = true;
    return;
  }
  const FetchOutcome outcome = arrival.answer.outcome;
  const bool of_one_pack =
      outcome == FetchOutcome::kNotFound || outcome == FetchOutcome::kForbidden || outcome == FetchOutcome::kTooShort;
  if (arrival.wish.kind == kFace && of_one_pack) return loseObject(arrival.wish.object, why);
  fail(why);
}

void StaticSource::Impl::acceptArrival(RangeArrival&& arrival) {
  if (arrival.answer.outcome != FetchOutcome::kBytes) return acceptFailure(arrival);
  succeeded = true;
  if (arrival.wish.kind == kBlock)
    return acceptBlock(static_cast<std::uint32_t>(arrival.wish.key), arrival.answer.bytes);
  if (arrival.wish.kind == kIndexBlock) return acceptIndexBlock(arrival.wish.key, arrival.answer.bytes);
  if (arrival.wish.kind == kFace) {
    if (const auto key = FaceKey::fromCode(arrival.wish.key)) acceptFace(*key, std::move(arrival.answer.bytes));
    return;
  }
  if (auto taken = acceptTable(arrival); !taken)
    fail(scene.place + "/" + arrival.wish.object + ": " + taken.error().message);
}

base::Result<void> StaticSource::Impl::acceptTable(const RangeArrival& arrival) {
  switch (arrival.wish.kind) {
    case kPatchFront:
      return acceptPatchFront(arrival.answer.bytes);
    case kIndexFront:
      return acceptIndexFront(arrival.answer.bytes);
    case kParameters:
      return acceptParameters(arrival.answer.bytes);
    default:
      return acceptPage(static_cast<std::uint32_t>(arrival.wish.key), arrival.answer.bytes);
  }
}

base::Result<void> StaticSource::Impl::acceptPatchFront(base::ByteView bytes) {
  LUMIGRID_ASSIGN_OR_RETURN(auto counts, lod::patch::readTableCounts(bytes));
  if (counts.file_bytes != scene.patches.bytes) return badScene("is not as long as scene.json says");
  if (counts.groups > protocol::kMaxGroups || counts.patches > protocol::kMaxPatches)
    return badScene("has more groups than a client takes");
  front.assign(bytes.begin(), bytes.end());
  tables.emplace(counts);
  tables->add(0, bytes);
  stats.table_bytes += std::min<std::uint64_t>(bytes.size(), counts.blocks_offset);
  hierarchy.lattice = counts.lattice;
  hierarchy.has_colors = counts.has_colors;
  hierarchy.source_triangles = counts.source_triangles;
  has_group.assign(counts.groups, false);

  // Groups are numbered from the top down, so the rows that are here belong to the coarsest groups.
  lod::patch::Hierarchy rows;
  for (std::uint32_t g = 0; g < tables->leadingRows(); ++g) {
    LUMIGRID_ASSIGN_OR_RETURN(auto row, tables->row(g));
    rows.groups.push_back(*row);
  }
  if (rows.groups.empty()) rows.groups.resize(1);
  coarse = plan::coarseGroups(rows, plan::kCoarseBytes);
  return checkTables();
}

base::Result<void> StaticSource::Impl::acceptIndexFront(base::ByteView bytes) {
  LUMIGRID_ASSIGN_OR_RETURN(auto decoded, repository::decodeIndexRoot(bytes));
  if (decoded.object_bytes != scene.index->bytes) return badScene("is not as long as scene.json says");
  root = std::move(decoded);
  stats.index_bytes += bytes.size();
  const std::uint64_t end = repository::parameterOffset() + root->parameter_bytes;
  if (end > bytes.size()) return {};  // a large tree does not fit into the front; urgentWishes() requests it
  return acceptParameters(bytes.subspan(repository::parameterOffset(), root->parameter_bytes));
}

base::Result<void> StaticSource::Impl::acceptParameters(base::ByteView bytes) {
  LUMIGRID_TRY(repository::checkParameters(*root, bytes));
  LUMIGRID_ASSIGN_OR_RETURN(auto read, read_parameters(std::string(bytes.begin(), bytes.end())));
  points = std::move(read);
  points_known = true;
  return {};
}

base::Result<void> StaticSource::Impl::acceptPage(std::uint32_t page, base::ByteView bytes) {
  tables->add(tables->pageOffset(page), bytes);
  stats.table_bytes += bytes.size();
  replan = pick_data_arrived = true;
  return checkTables();
}

/// Checks what single rows cannot show (the checksum), once the tables are complete.
base::Result<void> StaticSource::Impl::checkTables() {
  if (!tablesWhole() || tables_checked) return {};
  tables_checked = true;
  return tables->checkWhole();
}

/// Hands a block to the session. `rest` is the part of it that does not lie in the front.
void StaticSource::Impl::acceptBlock(std::uint32_t group, base::ByteView rest) {
  const auto record = tables->record(group);
  if (!record || has_group[group]) return;
  const lod::patch::Group& row = hierarchy.groups[group];
  const std::uint64_t begin = std::min<std::uint64_t>(row.block_offset, front.size());
  const std::uint64_t end = std::min<std::uint64_t>(row.block_offset + row.block_bytes, front.size());
  base::Bytes block(front.begin() + static_cast<std::ptrdiff_t>(begin),
                    front.begin() + static_cast<std::ptrdiff_t>(end));
  block.insert(block.end(), rest.begin(), rest.end());
  has_group[group] = true;
  group_bytes += block.size();
  picks.keepBlock(group, block);
  pick_data_arrived = true;
  keepCoarseBlock(group, block);
  outgoing.push_back({protocol::encode(protocol::Refinement{record->bytes, std::move(block)}), {}, group});
}

void StaticSource::Impl::keepCoarseBlock(std::uint32_t group, const base::Bytes& block) {
  if (sight_computed || !scene.index) return;
  coarse_blocks.resize(coarse.size());
  const auto at = static_cast<std::size_t>(std::find(coarse.begin(), coarse.end(), group) - coarse.begin());
  if (at < coarse.size()) coarse_blocks[at] = block;
}

/// Computes which coarse groups hide which. Where a block is damaged or missing, images are chosen as if nothing were
/// hidden.
void StaticSource::Impl::computeSight() {
  if (std::exchange(sight_computed, true) || coarse_blocks.empty()) return;
  auto seen = plan::makeCoarseSight(hierarchy, coarse, [this](std::uint32_t group) -> base::ByteView {
    return coarse_blocks[static_cast<std::size_t>(std::find(coarse.begin(), coarse.end(), group) - coarse.begin())];
  });
  if (seen) sight = std::move(*seen);
  coarse_blocks = {};
}

void StaticSource::Impl::acceptIndexBlock(std::uint64_t number, base::ByteView bytes) {
  stats.index_bytes += bytes.size();
  auto block = repository::decodeIndexBlock(*root, number, bytes);
  if (!block) {
    broken_index_blocks.insert(number);
    ++stats.broken;
    return reportProblem(scene.place + "/" + scene.index->name + ": block " + std::to_string(number) + ": " +
                         block.error().message + "; its images are not shown");
  }
  const std::uint64_t taken = block->bytes();
  index_blocks.insert(number, std::move(*block), taken);
  index_blocks.evict([number](std::uint64_t other) { return other == number; });
}

void StaticSource::Impl::acceptFace(const FaceKey& key, base::Bytes bytes) {
  if (has_face.count(key) != 0) return;
  if (bytes.size() > protocol::kMaxPayload || !repository::decodeFaceValue(bytes)) {
    gone.insert(key);
    ++stats.broken;
    return reportProblem(scene.place +
                         ": an image is damaged; publish the scene again with `lumigrid publish --rewrite`");
  }
  has_face.insert(key);
  face_bytes += bytes.size();
  outgoing.push_back({protocol::encode(protocol::Face{key, std::move(bytes)}), key, {}});
}

}  // namespace client
