#include "client/source/static_source.h"

#include <algorithm>

#include "base/geometry.h"
#include "lod/patch/format.h"
#include "repository/faces/face_value.h"

namespace client {
namespace {

// The numbers are choices; more wishes find more neighbours to fetch in one request, and are compared longer.
constexpr std::size_t kWishesAhead = 64;  // looked through for neighbours of a request
/// Counted ahead of need for an image whose place in the packs is not known yet: it takes a block of the index, too.
/// With the bytes of an image alone, cedar_creek over 1 Mbit/s had 25 dB half a second later.
constexpr std::uint64_t kUnlocatedFaceBytes = 20'000;
/// A link that carries fewer bytes a second is thin. A choice: over 384 kbit/s the coarse model would come later
/// (docs/decisions/static-scenes.md).
constexpr double kThinLink = 90'000.0;

}  // namespace

// ---- the hierarchy ----

RangeWish StaticSource::chunkWish(std::uint32_t chunk) const {
  return {kChunk, chunk, scene_.records.name, records_->chunkOffset(chunk), records_->chunkBytes(chunk), false, true};
}

/// A block that lies in one of the first ranges is handed over at once.
void StaticSource::wishForBlock(std::uint32_t group, std::vector<RangeWish>& wishes) {
  const lod::patch::Group& row = hierarchy_.groups[group];
  const std::uint64_t end = row.block_offset + row.block_bytes;
  for (const auto& [range, bytes] : opening_) {
    const std::uint64_t offset = scene_.patches.opening[range].offset;
    if (row.block_offset >= offset && end <= offset + bytes.size())
      return acceptBlock(group, base::ByteView(bytes).subspan(row.block_offset - offset, row.block_bytes));
  }
  wishes.push_back({kBlock, group, scene_.patches.name, row.block_offset, row.block_bytes, group == 0});
}

/// Reads a group's record into the hierarchy when its chunk is here, else adds that to `wishes`. Returns whether the
/// group is known.
bool StaticSource::readRecord(std::uint32_t group, std::vector<RangeWish>* wishes) {
  if (isKnown(group)) return true;
  if (broken_groups_.count(group) != 0) return false;
  const base::ByteView record = records_->record(group);
  if (record.empty()) {
    if (wishes != nullptr) wishes->push_back(chunkWish(GroupRecords::chunkOf(group)));
    return false;
  }
  base::ByteReader in(record);
  auto added = lod::patch::addGroup(in, hierarchy_, records_->counts().groups, records_->counts().patches);
  if (!added) {
    loseGroup(group, added.error().message);
    return false;
  }
  const std::uint64_t block_bytes = hierarchy_.groups[group].block_bytes;
  if (block_bytes > 0 && record.size() + block_bytes <= protocol::kMaxPayload) return true;
  loseGroup(group, badScene("group " + std::to_string(group) + " is too large to be taken").message);
  return false;
}

/// Marks a group as one that cannot be had. Without group 0 there is no scene.
void StaticSource::loseGroup(std::uint32_t group, const std::string& why) {
  if (!broken_groups_.insert(group).second) return;
  ++stats_.broken;
  const std::string message = scene_.place + "/" + scene_.records.name + ": " + why;
  if (group == 0)
    fail(message);
  else
    reportProblem(message);
}

// ---- the images ----

RangeWish StaticSource::indexWish(std::uint64_t number) const {
  return {kIndexBlock, number, scene_.index->name, root_->blockOffset(number), root_->bytesToRead(number)};
}

/// Finds out how to get a face. With kWanted, `wish` is the next range that it needs. An empty face is handed over at
/// once.
StaticSource::FaceState StaticSource::locateFace(const FaceKey& key, RangeWish& wish) {
  const std::uint64_t code = key.code();
  const std::uint64_t number = repository::blockOfCode(*root_, code);
  if (broken_index_blocks_.count(number) != 0) {
    gone_.insert(key);
    return FaceState::kGone;
  }
  const repository::IndexBlock* block = index_blocks_.find(number);
  if (block == nullptr) {
    wish = indexWish(number);
    return FaceState::kWanted;
  }
  const auto place = block->find(code);
  // A tile that was not worth storing has an ancestor that shows as much.
  if (!place && key.tile != 0) {
    gone_.insert(key);
    const FaceKey parent{key.x, key.y, key.z, key.d, repository::parentOfTile(key.tile)};
    return settled(parent) ? FaceState::kGone : locateFace(parent, wish);
  }
  const std::string pack = place ? repository::packName(place->pack) : "";
  if (!place || lost_objects_.count(pack) != 0) {
    gone_.insert(key);
    ++stats_.missing;
    return FaceState::kGone;
  }
  if (place->length == 0) {
    acceptFace(key, repository::encodeFaceValue({}));
    return FaceState::kHere;
  }
  wish = {kFace, code, pack, place->offset, place->length};
  return FaceState::kWanted;
}

// ---- the plan ----

plan::Scene StaticSource::planScene() {
  const protocol::Welcome& welcome = scene_.welcome;
  const lod::patch::Group* root = records_->row(0);  // its block is the first
  const bool is_fast = previous_ && newest_ && plan::isMoving(welcome, *newest_, *previous_) &&
                       plan::isFast(previous_->camera, newest_->camera, newest_at_ - previous_at_,
                                    static_cast<double>(glm::length(welcome.box_max - welcome.box_min)));
  const bool rests = previous_ && newest_ && base::showsSameView(previous_->camera, newest_->camera);
  return {.welcome = &scene_.welcome,
          .hierarchy = &hierarchy_,
          .images = scene_.index.has_value(),
          .sample_tree = points_.treeOrNull(),
          .sight = sight_ ? &*sight_ : nullptr,
          .stored_bytes = [this](const FaceKey& key) { return storedBytes(key); },
          .image_bytes = image_bytes_,
          .is_fast = is_fast,
          .is_fresh = !rests,
          .rests = rests,
          .link_rate = queue_.rate(),
          .patch_bytes = records_->counts().patch_bytes - (root != nullptr ? root->block_offset : 0)};
}

/// Bytes of an image as the index has them (plan::StoredBytes).
std::optional<std::uint64_t> StaticSource::storedBytes(const FaceKey& key) {
  if (gone_.count(key) != 0) return 0;
  if (!root_) return std::nullopt;
  const repository::IndexBlock* block = index_blocks_.find(repository::blockOfCode(*root_, key.code()));
  if (block == nullptr) return std::nullopt;
  const auto place = block->find(key.code());
  return place ? place->length : 0;
}

/// Returns the unknown groups that the cut would expand, the largest error first: they made patches that the cut draws,
/// lie in view, and exceed the tolerance.
std::vector<StaticSource::UnknownGroup> StaticSource::frontierOf(const lod::patch::Cut& cut,
                                                                 const lod::patch::CutRequest& request) {
  const base::Frustum frustum(request.camera.clipFromScene());
  const float pixels = request.camera.pixelsPerUnitAtOne();
  std::vector<UnknownGroup> found;
  std::unordered_set<std::uint32_t> seen;
  for (const std::uint32_t group : cut.expanded) {
    const lod::patch::Group& g = hierarchy_.groups[group];
    for (std::uint32_t i = g.first_patch; i < g.first_patch + g.patch_count; ++i) {
      const std::uint32_t producer = hierarchy_.patches[i].producer;
      if (producer == lod::patch::kNoGroup || isKnown(producer) || broken_groups_.count(producer) != 0) continue;
      if (!seen.insert(producer).second) continue;
      // Until its record is here, its errors are those that came with the patch, and its sphere that of the group
      // above, which holds it.
      const lod::patch::Group* row = records_->row(producer);
      const base::Sphere& bounds = row != nullptr ? row->bounds : g.bounds;
      if (!frustum.mayOverlap(bounds)) continue;
      const auto projected = [&](base::ErrorMeasure measure) {
        const float error = row != nullptr ? lod::patch::errorOf(*row, measure)
                                           : lod::patch::ownErrorOf(hierarchy_.patches[i], measure);
        return base::projectedError(error, bounds.center, bounds.radius, request.camera.eye, pixels,
                                    request.near_plane);
      };
      const float error_px = projected(request.measure);
      if (error_px <= request.tolerance_px && request.tolerance_px > 0.0F) continue;
      const bool has_images = scene_.index.has_value() && request.measure == base::ErrorMeasure::kVisible;
      const bool needed = !has_images || projected(base::ErrorMeasure::kShape) > request.tolerance_px;
      found.push_back({producer, error_px, needed});
    }
  }
  std::sort(found.begin(), found.end(), [](const UnknownGroup& a, const UnknownGroup& b) {
    return a.error_px != b.error_px ? a.error_px > b.error_px : a.group < b.group;
  });
  return found;
}

plan::Holdings StaticSource::holdings() {
  return {[this](const FaceKey& key) { return settled(key); }, [this](std::uint32_t group) { return settled(group); }};
}

/// Descends as far as the present records allow, then plans as a server does.
void StaticSource::planNewestView() {
  const bool sight_is_due = coarse_is_here_ && !sight_computed_;
  if (planned_ && !index_learned_ && !sight_is_due && !(replan_ && !frontier_.empty())) return;
  if (sight_is_due) computeSight();
  const lod::patch::CutRequest request = plan::cutRequestFor(scene_.welcome, plan::viewToPlan(planScene(), *newest_));
  for (bool learned = true; learned;) {
    learned = false;
    frontier_ = frontierOf(lod::patch::selectCut(hierarchy_, request), request);
    for (const UnknownGroup& unknown : frontier_) learned |= readRecord(unknown.group, nullptr);
  }
  std::erase_if(frontier_, [this](const UnknownGroup& unknown) { return broken_groups_.count(unknown.group) != 0; });
  view_plan_ = plan::planView(planScene(), *newest_, holdings());
  if (!planned_) ahead_.reset();
  planned_ = true;
  replan_ = false;
  index_learned_ = false;
}

/// Wishes for what scene.json names for the first picture. Returns whether all is here.
bool StaticSource::wishForOpening(std::vector<RangeWish>& wishes) const {
  const std::vector<base::FileRange>& opening = scene_.patches.opening;
  const std::size_t before = wishes.size();
  if (!records_) wishes.push_back({kRecordFront, 0, scene_.records.name, 0, scene_.records.opening.front().length});
  for (std::size_t i = 0; i < opening.size(); ++i)
    if (opening_.count(i) == 0)
      wishes.push_back({kOpening, i, scene_.patches.name, opening[i].offset, opening[i].length});
  return wishes.size() == before;
}

void StaticSource::wishForCoarse(std::vector<RangeWish>& wishes) {
  for (const std::uint32_t group : coarse_)
    if (!settled(group) && readRecord(group, &wishes) && !has_group_[group]) wishForBlock(group, wishes);
}

/// Wishes for the blocks of the index that say which images the plan's points have, and how large they are. Returns
/// whether any of them is here: images of its points can be chosen, and need not wait for those of a point that a
/// moving eye has just come near.
bool StaticSource::wishForIndex(std::vector<RangeWish>& wishes) {
  if (!root_) return true;
  bool any_here = false;
  index_wanted_.clear();
  for (const glm::uvec3& point : view_plan_.points) {
    const std::uint64_t number = repository::blockOfCode(*root_, FaceKey{point.x, point.y, point.z}.code());
    index_wanted_.insert(number);
    if (broken_index_blocks_.count(number) != 0 || index_blocks_.find(number) != nullptr)
      any_here = true;
    else
      wishes.push_back(indexWish(number));
  }
  return any_here || view_plan_.points.empty();
}

/// Collects wishes in a server's order (server::Session::nextWanted), as far ahead as requests are put together. Images
/// wait for some of the index, by which they are chosen, and so do groups that bring no more than colours.
void StaticSource::wishForView(std::vector<RangeWish>& wishes) {
  const auto readFrontier = [&](bool needed) {
    for (const UnknownGroup& unknown : frontier_)
      if (unknown.is_needed == needed && wishes.size() < kWishesAhead) readRecord(unknown.group, &wishes);
  };
  readFrontier(true);
  std::vector<RangeWish> index;
  const bool index_tells = wishForIndex(index);
  // A thin link has no room for blocks of the index that no image waits for: they are asked for with the first image
  // of theirs.
  const bool is_thin = std::max(queue_.rate(), queue_.rateOnceBegun()) < kThinLink;
  if (!is_thin) wishes.insert(wishes.end(), index.begin(), index.end());
  const bool takes_faces = index_tells || is_thin;
  std::size_t g = 0;
  std::size_t f = takes_faces ? 0 : view_plan_.faces.size();
  stats_.wanted = static_cast<std::uint32_t>(frontier_.size());
  while (wishes.size() < kWishesAhead) {
    while (g < view_plan_.groups.size() && (settled(view_plan_.groups[g]) || !(takes_faces || view_plan_.is_needed[g])))
      ++g;
    while (f < view_plan_.faces.size() && settled(view_plan_.faces[f])) ++f;
    const bool group_left = g < view_plan_.groups.size();
    const bool face_left = f < view_plan_.faces.size();
    if (!group_left && !face_left) break;
    ++stats_.wanted;

    if (group_left && (!face_left || view_plan_.faces_before[g] <= f)) {
      wishForBlock(view_plan_.groups[g++], wishes);
      continue;
    }
    RangeWish wish;
    if (locateFace(view_plan_.faces[f++], wish) == FaceState::kWanted) wishes.push_back(wish);
  }
  readFrontier(false);
  if (!wishes.empty() || complete_sent_ || !coarse_is_here_) return;
  complete_sent_ = true;
  outgoing_.push_back({protocol::encode(protocol::Completion{newest_->sequence})});
}

/// Returns everything that is needed now, the most urgent first.
std::vector<RangeWish> StaticSource::urgentWishes() {
  std::vector<RangeWish> wishes;
  const bool opening_is_here = wishForOpening(wishes);
  if (scene_.index && !root_)
    wishes.push_back({kIndexFront, 0, scene_.index->name, 0, scene_.index->opening.front().length});
  if (!opening_is_here || phase_ == Phase::kFailed) return wishes;

  wishForCoarse(wishes);
  if (phase_ == Phase::kFailed || (!has_group_[0] && !wishes.empty())) return wishes;
  // The round trips until the coarse model is whole would leave the link idle. A thin one has no room for more.
  coarse_is_here_ = wishes.empty();
  if (phase_ != Phase::kOpen || (!coarse_is_here_ && queue_.rateOnceBegun() < kThinLink)) return wishes;
  std::vector<RangeWish> of_view;
  if (newest_) {
    planNewestView();
    wishForView(of_view);
  }
  wishForPick(wishes);
  wishes.insert(wishes.end(), of_view.begin(), of_view.end());
  return wishes;
}

/// Returns what later views may need.
std::vector<RangeWish> StaticSource::prefetchWishes() {
  std::vector<RangeWish> wishes;
  if (!complete_sent_ || !planned_ || phase_ != Phase::kOpen) return wishes;
  std::uint64_t bytes = 0;
  if (!ahead_) {
    ahead_ = view_plan_.other_faces;
    if (previous_) {
      const auto along = plan::planMotion(planScene(), *newest_, *previous_, holdings());
      ahead_->insert(ahead_->end(), along.begin(), along.end());
    }
  }
  for (const FaceKey& key : *ahead_) {
    if (bytes >= plan::kPrefetchBytes || wishes.size() >= kWishesAhead) break;
    RangeWish wish;
    if (gone_.count(key) != 0) continue;
    const FaceState state = has_face_.count(key) != 0 ? FaceState::kHere : locateFace(key, wish);
    if (state == FaceState::kWanted) wishes.push_back(wish);
    bytes += wish.kind == kFace ? wish.length : kUnlocatedFaceBytes;
  }
  return wishes;
}

// ---- picked rays ----

void StaticSource::castPicks(Session& session) {
  if (phase_ == Phase::kFailed) return picks_.giveUp();
  if (!picks_.waiting() || !pick_data_arrived_ || !linked_ || phase_ != Phase::kOpen || !isKnown(0)) return;
  pick_data_arrived_ = false;
  const std::string before = picks_.problem();
  picks_.castWaiting(
      hierarchy_,
      [&session](std::uint32_t group) -> base::Result<std::optional<base::ByteView>> {
        const base::Bytes* block = session.block(group);
        return block != nullptr ? std::optional<base::ByteView>(*block) : std::nullopt;
      },
      [this](std::uint32_t group) {
        if (readRecord(group, nullptr)) return RayPicks::RecordStatus::kHere;
        return broken_groups_.count(group) != 0 ? RayPicks::RecordStatus::kBroken : RayPicks::RecordStatus::kMissing;
      });
  if (picks_.problem() != before) reportProblem(scene_.place + "/" + scene_.patches.name + ": " + picks_.problem());
  // The session may have dropped these since its last View.
  for (const std::uint32_t group : picks_.needed())
    if (!session.hasGroup(group)) has_group_[group] = false;
}

void StaticSource::wishForPick(std::vector<RangeWish>& wishes) {
  for (const std::uint32_t group : picks_.needed())
    if (readRecord(group, &wishes) && !has_group_[group]) wishForBlock(group, wishes);
}

}  // namespace client
