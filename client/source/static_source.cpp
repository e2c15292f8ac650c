#include "client/source/static_source.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <unordered_set>
#include <utility>
#include <vector>

#include "base/geometry.h"
#include "lod/patch/format.h"
#include "lod/patch/table_pages.h"
#include "lod/patch/traverse.h"
#include "plan/coarse_sight.h"
#include "plan/view_plan.h"
#include "repository/cache.h"
#include "repository/faces/face_value.h"
#include "repository/packs/pack_format.h"

namespace client {
namespace {

using lod::patch::TablePages;
using repository::FaceKey;

enum Kind : std::uint32_t { kPatchFront, kIndexFront, kParameters, kPage, kBlock, kIndexBlock, kFace };

constexpr std::uint64_t kPatchFrontBytes = 16 * 1024;
constexpr std::size_t kWishesAhead = 64;         // looked through for neighbours of a request
constexpr std::size_t kRequestsAheadOfNeed = 2;  // of the 6 that may be under way, so that a new view finds room
constexpr std::uint64_t kTypicalFaceBytes = 20'000;
constexpr double kMinPause = 0.25, kMaxPause = 5.0;  // seconds
/// One failed request is not reported: hosts close kept connections now and then.
constexpr int kFailuresToTell = 2;

base::Error bad(const std::string& what) {
  return {base::ErrorCode::kInvalidInput, what + "; publish the scene again"};
}

}  // namespace

struct StaticSource::Impl {
  enum class Phase { kOpening, kOpen, kFailed };

  Impl(StaticScene what, RangeFetcher& fetcher, ReadParameters reader, const StaticOptions& wanted)
      : scene(std::move(what)),
        read_parameters(std::move(reader)),
        options(wanted),
        queue(fetcher, wanted.queue),
        index_blocks(wanted.index_cache_bytes) {
    if (auto sound = checkScene(); !sound) fail(scene.place + ": " + sound.error().message);
  }

  base::Result<void> checkScene() const;

  // ---- answers of the fetcher ----
  void acceptArrival(RangeArrival&& arrival);
  base::Result<void> acceptTable(const RangeArrival& arrival);
  base::Result<void> acceptPatchFront(base::ByteView bytes);
  base::Result<void> acceptIndexFront(base::ByteView bytes);
  base::Result<void> acceptParameters(base::ByteView bytes);
  base::Result<void> acceptPage(std::uint32_t page, base::ByteView bytes);
  base::Result<void> checkTables();
  void acceptBlock(std::uint32_t group, base::ByteView rest);
  void acceptIndexBlock(std::uint64_t number, base::ByteView bytes);
  void acceptFace(const FaceKey& key, base::Bytes bytes);
  void acceptFailure(const RangeArrival& arrival);
  void loseObject(const std::string& object, const std::string& why);
  void reportProblem(const std::string& what) { problem = what; }
  void fail(const std::string& why);

  // ---- messages from and to the session ----
  void readMessages(Session& session);
  void acceptMessage(const protocol::ClientMessage& message);
  void deliverMessages(Session& session);

  // ---- the hierarchy ----
  void openScene();
  bool readRecord(std::uint32_t group, std::vector<RangeWish>* wishes);
  bool isKnown(std::uint32_t group) const { return group < hierarchy.known.size() && hierarchy.known[group] != 0; }
  bool tablesFirst() const { return tables->counts().blocks_offset <= options.eager_table_bytes; }
  bool tablesWhole() const { return tables->pagesHere() == tables->pageCount(); }
  void wishForTables(std::vector<RangeWish>& wishes) const;
  RangeWish pageWish(std::uint32_t page) const;
  void wishForBlock(std::uint32_t group, std::vector<RangeWish>& wishes);

  void keepCoarseBlock(std::uint32_t group, const base::Bytes& block);
  void computeSight();

  // ---- the images ----
  enum class FaceState { kHere, kGone, kWanted };
  FaceState locateFace(const FaceKey& key, RangeWish& wish);
  bool settled(const FaceKey& key) const { return has_face.count(key) != 0 || gone.count(key) != 0; }

  // ---- the plan ----
  plan::Scene planScene() const;
  void planNewestView();
  std::vector<std::uint32_t> frontierOf(const lod::patch::Cut& cut, const lod::patch::CutRequest& request);
  bool settled(std::uint32_t group) const { return has_group[group] || broken_groups.count(group) != 0; }
  std::vector<RangeWish> urgentWishes();
  void wishForCoarse(std::vector<RangeWish>& wishes);
  void wishForView(std::vector<RangeWish>& wishes);
  std::vector<RangeWish> prefetchWishes();

  // ---- picked rays ----
  void castPicks(Session& session);
  void wishForPick(std::vector<RangeWish>& wishes);

  StaticScene scene;
  ReadParameters read_parameters;
  StaticOptions options;
  RangeQueue queue;
  Phase phase = Phase::kOpening;
  std::string problem, failure;
  StaticStats stats;

  // The link, as the session sees it.
  bool linked = false;       // the session was told connected()
  bool welcome_due = false;  // a Hello waits for its Welcome
  int failures = 0;          // consecutive ones
  std::string last_failure;
  bool succeeded = false;  // since pump() began
  bool retry_set = false;
  double retry_at = 0.0;
  struct Outgoing {
    base::Bytes bytes;
    std::optional<FaceKey> face = {};
    std::optional<std::uint32_t> group = {};
  };
  std::deque<Outgoing> outgoing;

  // Data that were read.
  base::Bytes front;  // front of the hierarchy's file; that of a small file holds blocks too
  std::optional<TablePages> tables;
  lod::patch::Hierarchy hierarchy;  // the groups whose records were read
  bool tables_checked = false;
  std::unordered_set<std::uint32_t> broken_groups;
  std::optional<repository::IndexRoot> root;
  repository::SampledPoints points;
  bool points_known = false;
  repository::LruCache<std::uint64_t, repository::IndexBlock> index_blocks;
  std::unordered_set<std::uint64_t> broken_index_blocks;
  std::unordered_set<std::string> lost_objects;

  // Items that the session holds, and faces that cannot be had.
  std::vector<bool> has_group;
  std::unordered_set<FaceKey> has_face, gone;
  std::vector<std::uint32_t> coarse;

  // Blocks of the coarse groups, kept until the occlusion between them is computed, once, before the first view is
  // planned.
  std::vector<base::Bytes> coarse_blocks;  // beside `coarse`
  std::optional<lod::patch::ProxySight> sight;
  bool sight_computed = false;

  // The views and their plan.
  std::optional<protocol::View> newest, previous;
  bool planned = false, replan = false;
  plan::ViewPlan view_plan;
  std::vector<std::uint32_t> frontier;  // groups without a record that the cut leads to
  bool frontier_urgent = false;
  std::uint64_t group_bytes = 0, face_bytes = 0;  // handed over for this view
  bool complete_sent = false;
  std::optional<std::vector<FaceKey>> ahead;

  RayPicks picks;
  bool pick_data_arrived = false;  // data arrived that the first ray may need
};

/// Names come from outside; only names in the form that `lumigrid publish` writes lead to requests.
base::Result<void> StaticSource::Impl::checkScene() const {
  const auto notPublished = [](const std::string& what) {
    return base::Error{base::ErrorCode::kInvalidInput, what + "; put there what `lumigrid publish` wrote"};
  };
  const std::string& patches = scene.patches.name;
  const std::string begin = "patch-";
  const std::string end = ".lgp";
  const bool named = patches.size() == begin.size() + 32 + end.size() && patches.compare(0, begin.size(), begin) == 0 &&
                     patches.compare(patches.size() - end.size(), end.size(), end) == 0 &&
                     patches.find_first_not_of("0123456789abcdef", begin.size()) == patches.size() - end.size();
  if (!named || scene.patches.bytes == 0) return notPublished("this scene.json names no published hierarchy");
  if (scene.index && (!repository::idOfIndexName(scene.index->name) || scene.index->bytes == 0))
    return notPublished("this scene.json names no published images");
  return {};
}

// ---- answers of the fetcher ----

void StaticSource::Impl::fail(const std::string& why) {
  if (phase == Phase::kFailed) return;
  phase = Phase::kFailed;
  failure = why;
}

/// Marks the faces of this object as gone.
void StaticSource::Impl::loseObject(const std::string& object, const std::string& why) {
  lost_objects.insert(object);
  reportProblem(why);
}

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
  if (counts.file_bytes != scene.patches.bytes) return bad("is not as long as scene.json says");
  if (counts.groups > protocol::kMaxGroups || counts.patches > protocol::kMaxPatches)
    return bad("has more groups than a client takes");
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
  if (decoded.object_bytes != scene.index->bytes) return bad("is not as long as scene.json says");
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

// ---- messages from and to the session ----

void StaticSource::Impl::acceptMessage(const protocol::ClientMessage& message) {
  if (std::get_if<protocol::Hello>(&message) != nullptr) {
    welcome_due = true;
    // Holdings will tell what the session has, except what is still in `outgoing`.
    has_face.clear();
    has_group.assign(has_group.size(), false);
    for (const Outgoing& queued : outgoing) {
      if (queued.face) has_face.insert(*queued.face);
      if (queued.group) has_group[*queued.group] = true;
    }
  } else if (const auto* view = std::get_if<protocol::View>(&message)) {
    if (planned) previous = newest;
    newest = *view;
    planned = complete_sent = false;
  } else if (const auto* evicted = std::get_if<protocol::Eviction>(&message)) {
    for (const FaceKey& key : evicted->faces) has_face.erase(key);
    for (const std::uint32_t group : evicted->groups)
      if (group < has_group.size()) has_group[group] = false;
  } else if (const auto* have = std::get_if<protocol::Holdings>(&message)) {
    has_face.insert(have->faces.begin(), have->faces.end());
    for (const std::uint32_t group : have->groups)
      if (group < has_group.size()) has_group[group] = true;
  }
}

void StaticSource::Impl::readMessages(Session& session) {
  while (const auto bytes = session.nextToSend())
    if (const auto message = protocol::decodeClientMessage(*bytes)) acceptMessage(*message);
}

void StaticSource::Impl::deliverMessages(Session& session) {
  if (!linked || phase != Phase::kOpen) return;
  if (std::exchange(welcome_due, false)) outgoing.push_front({protocol::encode(scene.welcome)});
  while (!outgoing.empty()) {
    const Outgoing message = std::move(outgoing.front());
    outgoing.pop_front();
    if (message.face && !session.options().images) {  // images were switched off meanwhile
      has_face.erase(*message.face);
      continue;
    }
    if (auto taken = session.receive(message.bytes); !taken) return fail(scene.place + ": " + taken.error().message);
    readMessages(session);
  }
}

// ---- the hierarchy ----

/// Completes the Welcome once both fronts are here.
void StaticSource::Impl::openScene() {
  if (phase != Phase::kOpening || !tables || (scene.index && !points_known)) return;
  const lod::patch::TableCounts& counts = tables->counts();
  protocol::Welcome& welcome = scene.welcome;
  welcome.version = protocol::kVersion;
  welcome.has_colors = counts.has_colors;
  welcome.lattice_origin = counts.lattice.origin;
  welcome.lattice_step = counts.lattice.step;
  welcome.group_count = counts.groups;
  welcome.patch_count = counts.patches;
  welcome.source_triangles = counts.source_triangles;
  welcome.can_render_frames = false;
  if (scene.index) welcome.grid = points.grid;
  phase = Phase::kOpen;
}

RangeWish StaticSource::Impl::pageWish(std::uint32_t page) const {
  return {kPage, page, scene.patches.name, tables->pageOffset(page), tables->pageLength(page)};
}

/// Requests the part of a block that is not in the front; a block that lies in it entirely is handed over at once.
void StaticSource::Impl::wishForBlock(std::uint32_t group, std::vector<RangeWish>& wishes) {
  const lod::patch::Group& row = hierarchy.groups[group];
  const std::uint64_t end = row.block_offset + row.block_bytes;
  if (end <= front.size()) return acceptBlock(group, {});
  const std::uint64_t begin = std::max<std::uint64_t>(row.block_offset, front.size());
  wishes.push_back({kBlock, group, scene.patches.name, begin, end - begin, group == 0});
}

/// Reads a group's record into the hierarchy when all its table pages are here, else adds the missing pages to
/// `wishes`. Returns whether the group is known.
bool StaticSource::Impl::readRecord(std::uint32_t group, std::vector<RangeWish>* wishes) {
  if (isKnown(group)) return true;
  if (broken_groups.count(group) != 0) return false;
  const auto record = tables->record(group);
  std::optional<base::Error> error;
  if (!record) {
    error = record.error();
  } else if (!record->missing.empty()) {
    if (wishes != nullptr)
      for (const std::uint32_t page : record->missing) wishes->push_back(pageWish(page));
    return false;
  } else {
    base::ByteReader in(record->bytes);
    auto added = lod::patch::addGroup(in, hierarchy, tables->counts().groups, tables->counts().patches);
    if (!added)
      error = added.error();
    else if (record->bytes.size() + hierarchy.groups[group].block_bytes > protocol::kMaxPayload ||
             hierarchy.groups[group].block_bytes == 0)
      error = bad("group " + std::to_string(group) + " is too large to be taken");
  }
  if (!error) return true;
  broken_groups.insert(group);
  ++stats.broken;
  const std::string why = scene.place + "/" + scene.patches.name + ": " + error->message;
  if (group == 0)
    fail(why);
  else
    reportProblem(why);
  return false;
}

void StaticSource::Impl::wishForTables(std::vector<RangeWish>& wishes) const {
  for (std::uint32_t page = 0; page < tables->pageCount(); ++page)
    if (!tables->has(page)) wishes.push_back(pageWish(page));
}

// ---- the images ----

/// Finds out how to get a face. With kWanted, `wish` is the next range that it needs. An empty face is handed over at
/// once.
StaticSource::Impl::FaceState StaticSource::Impl::locateFace(const FaceKey& key, RangeWish& wish) {
  const std::uint64_t code = key.code();
  const std::uint64_t number = repository::blockOfCode(*root, code);
  if (broken_index_blocks.count(number) != 0) {
    gone.insert(key);
    return FaceState::kGone;
  }
  const repository::IndexBlock* block = index_blocks.find(number);
  if (block == nullptr) {
    wish = {kIndexBlock, number, scene.index->name, root->blockOffset(number), root->block_bytes};
    return FaceState::kWanted;
  }
  const auto place = block->find(code);
  const std::string pack = place ? repository::packName(place->pack) : "";
  if (!place || lost_objects.count(pack) != 0) {
    gone.insert(key);
    ++stats.missing;
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

plan::Scene StaticSource::Impl::planScene() const {
  return {&scene.welcome, &hierarchy, scene.index.has_value(), points.treeOrNull(), sight ? &*sight : nullptr};
}

/// Returns the unknown groups that the cut would expand, the largest error first: they made patches that the cut draws,
/// lie in view, and exceed the tolerance.
std::vector<std::uint32_t> StaticSource::Impl::frontierOf(const lod::patch::Cut& cut,
                                                          const lod::patch::CutRequest& request) {
  const base::Frustum frustum(request.camera.clipFromScene());
  const float pixels = request.camera.pixelsPerUnitAtOne();
  std::vector<std::pair<float, std::uint32_t>> found;
  std::unordered_set<std::uint32_t> seen;
  for (const std::uint32_t group : cut.expanded) {
    const lod::patch::Group& g = hierarchy.groups[group];
    for (std::uint32_t i = g.first_patch; i < g.first_patch + g.patch_count; ++i) {
      const std::uint32_t producer = hierarchy.patches[i].producer;
      if (producer == lod::patch::kNoGroup || isKnown(producer) || broken_groups.count(producer) != 0) continue;
      if (!seen.insert(producer).second) continue;
      // Its row is present, since the record of the group above needed it.
      const auto row = tables->row(producer);
      if (!row || !row->has_value() || !frustum.mayOverlap((*row)->bounds)) continue;
      const float error_px = base::projectedError((*row)->error, (*row)->bounds.center, (*row)->bounds.radius,
                                                  request.camera.eye, pixels, request.near_plane);
      if (error_px > request.tolerance_px || request.tolerance_px <= 0.0F) found.emplace_back(error_px, producer);
    }
  }
  std::sort(found.begin(), found.end(),
            [](const auto& a, const auto& b) { return a.first != b.first ? a.first > b.first : a.second < b.second; });
  frontier_urgent = !found.empty() && plan::isUrgent(found.front().first, *newest);
  std::vector<std::uint32_t> groups;
  for (const auto& [error_px, group] : found) groups.push_back(group);
  return groups;
}

/// Descends as far as the present pages allow, then plans as a server does.
void StaticSource::Impl::planNewestView() {
  if (planned && !(replan && !frontier.empty())) return;
  computeSight();
  const lod::patch::CutRequest request = plan::cutRequestFor(scene.welcome, *newest);
  for (bool learned = true; learned;) {
    learned = false;
    frontier = frontierOf(lod::patch::selectCut(hierarchy, request), request);
    for (const std::uint32_t group : frontier) learned |= readRecord(group, nullptr);
  }
  std::erase_if(frontier, [this](std::uint32_t group) { return broken_groups.count(group) != 0; });
  view_plan = plan::planView(planScene(), *newest, [this](const FaceKey& key) { return settled(key); });
  if (!planned) {
    group_bytes = face_bytes = 0;
    ahead.reset();
  }
  planned = true;
  replan = false;
}

void StaticSource::Impl::wishForCoarse(std::vector<RangeWish>& wishes) {
  for (const std::uint32_t group : coarse)
    if (!settled(group) && readRecord(group, &wishes) && !has_group[group]) wishForBlock(group, wishes);
}

/// Collects wishes in a server's order (server::Session::nextWanted), as far ahead as requests are put together.
void StaticSource::Impl::wishForView(std::vector<RangeWish>& wishes) {
  for (const std::uint32_t group : frontier) {
    if (wishes.size() >= kWishesAhead) break;
    readRecord(group, &wishes);
  }
  std::uint64_t groups_ahead = group_bytes;
  std::uint64_t faces_ahead = face_bytes;
  std::size_t g = 0;
  std::size_t f = 0;
  stats.wanted = static_cast<std::uint32_t>(frontier.size());
  while (wishes.size() < kWishesAhead) {
    while (g < view_plan.groups.size() && settled(view_plan.groups[g])) ++g;
    while (f < view_plan.faces.size() && settled(view_plan.faces[f])) ++f;
    const bool group_left = g < view_plan.groups.size();
    const bool face_left = f < view_plan.faces.size() && !frontier_urgent;
    if (!group_left && !face_left) break;
    ++stats.wanted;

    const bool urgent = group_left && plan::isUrgent(view_plan.group_error_px[g], *newest);
    if (group_left && (!face_left || urgent || groups_ahead <= faces_ahead)) {
      const std::uint32_t group = view_plan.groups[g++];
      groups_ahead += hierarchy.groups[group].block_bytes;
      wishForBlock(group, wishes);
      continue;
    }
    RangeWish wish;
    if (locateFace(view_plan.faces[f++], wish) != FaceState::kWanted) continue;
    faces_ahead += wish.kind == kFace ? wish.length : kTypicalFaceBytes;
    wishes.push_back(wish);
  }
  if (!wishes.empty() || complete_sent) return;
  complete_sent = true;
  outgoing.push_back({protocol::encode(protocol::Completion{newest->sequence})});
}

/// Returns everything that is needed now, the most urgent first.
std::vector<RangeWish> StaticSource::Impl::urgentWishes() {
  std::vector<RangeWish> wishes;
  if (!tables)
    wishes.push_back({kPatchFront, 0, scene.patches.name, 0, std::min(kPatchFrontBytes, scene.patches.bytes)});
  if (scene.index && !root)
    wishes.push_back(
        {kIndexFront, 0, scene.index->name, 0, std::min(repository::kIndexFrontBytes, scene.index->bytes)});
  if (root && !points_known)
    wishes.push_back({kParameters, 0, scene.index->name, repository::parameterOffset(), root->parameter_bytes});
  if (!tables || phase == Phase::kFailed) return wishes;

  wishForCoarse(wishes);
  if (phase == Phase::kFailed || (!has_group[0] && !wishes.empty())) return wishes;
  if (tablesFirst() && !tablesWhole()) {
    wishForTables(wishes);
    return wishes;
  }
  if (phase != Phase::kOpen || !wishes.empty()) return wishes;
  std::vector<RangeWish> of_view;
  if (newest) {
    planNewestView();
    wishForView(of_view);
  }
  wishForPick(wishes);
  wishes.insert(wishes.end(), of_view.begin(), of_view.end());
  return wishes;
}

/// Returns what later views may need, small tables to their end included, because only whole tables can be checked
/// against their checksum.
std::vector<RangeWish> StaticSource::Impl::prefetchWishes() {
  std::vector<RangeWish> wishes;
  if (!complete_sent || !planned || phase != Phase::kOpen) return wishes;
  std::uint64_t bytes = 0;
  if (tables->counts().blocks_offset <= plan::kPrefetchBytes) {
    wishForTables(wishes);
    bytes += tables->counts().blocks_offset;
  }
  if (!ahead) {
    ahead = view_plan.other_faces;
    if (previous) {
      const auto along =
          plan::planMotion(planScene(), *newest, *previous, [this](const FaceKey& key) { return settled(key); });
      ahead->insert(ahead->end(), along.begin(), along.end());
    }
  }
  for (const FaceKey& key : *ahead) {
    if (bytes >= plan::kPrefetchBytes || wishes.size() >= kWishesAhead) break;
    RangeWish wish;
    if (gone.count(key) != 0) continue;
    const FaceState state = has_face.count(key) != 0 ? FaceState::kHere : locateFace(key, wish);
    if (state == FaceState::kWanted) wishes.push_back(wish);
    bytes += wish.kind == kFace ? wish.length : kTypicalFaceBytes;
  }
  return wishes;
}

// ---- picked rays ----

void StaticSource::Impl::castPicks(Session& session) {
  if (phase == Phase::kFailed) return picks.giveUp();
  if (!picks.waiting() || !pick_data_arrived || !linked || phase != Phase::kOpen || !isKnown(0)) return;
  pick_data_arrived = false;
  const std::string before = picks.problem();
  picks.castWaiting(
      hierarchy,
      [&session](std::uint32_t group) -> base::Result<std::optional<base::ByteView>> {
        const base::Bytes* block = session.block(group);
        return block != nullptr ? std::optional<base::ByteView>(*block) : std::nullopt;
      },
      [this](std::uint32_t group) {
        if (readRecord(group, nullptr)) return RayPicks::RecordStatus::kHere;
        return broken_groups.count(group) != 0 ? RayPicks::RecordStatus::kBroken : RayPicks::RecordStatus::kMissing;
      });
  if (picks.problem() != before) reportProblem(scene.place + "/" + scene.patches.name + ": " + picks.problem());
  // The session may have dropped these since its last View.
  for (const std::uint32_t group : picks.needed())
    if (!session.hasGroup(group)) has_group[group] = false;
}

void StaticSource::Impl::wishForPick(std::vector<RangeWish>& wishes) {
  for (const std::uint32_t group : picks.needed())
    if (readRecord(group, &wishes) && !has_group[group]) wishForBlock(group, wishes);
}

// ---- the public functions ----

StaticSource::StaticSource(StaticScene scene, RangeFetcher& fetcher, ReadParameters read_parameters,
                           const StaticOptions& options)
    : impl_(std::make_unique<Impl>(std::move(scene), fetcher, std::move(read_parameters), options)) {}
StaticSource::~StaticSource() = default;

bool StaticSource::pump(Session& session, double now) {
  Impl& s = *impl_;
  if (s.phase == Impl::Phase::kFailed) {
    if (session.phase() != SessionPhase::kRefused) session.refuse(s.failure);
    return false;
  }
  if (!s.linked && s.failures == 0) {
    s.linked = true;
    session.connected();
  }

  // Take in answers.
  s.succeeded = s.retry_set = false;
  auto arrivals = s.queue.takeArrivals();
  for (RangeArrival& arrival : arrivals) s.acceptArrival(std::move(arrival));
  if (s.succeeded) {
    s.failures = 0;
    if (!std::exchange(s.linked, true)) session.connected();
  } else if (s.retry_set) {
    s.retry_at = now + std::min(kMaxPause, kMinPause * std::exp2(std::min(s.failures, 8)));
    ++s.failures;
    if (s.linked && s.failures >= kFailuresToTell) {
      s.linked = false;
      session.disconnected(s.last_failure);
    }
  }
  s.openScene();
  s.readMessages(session);
  s.deliverMessages(session);
  s.castPicks(session);

  // Send requests.
  if (s.phase != Impl::Phase::kFailed && (s.failures == 0 || now >= s.retry_at)) {
    const bool was_complete = s.complete_sent;
    const std::vector<RangeWish> wishes = s.urgentWishes();
    s.queue.request(wishes);
    if (was_complete && wishes.empty()) s.queue.request(s.prefetchWishes(), kRequestsAheadOfNeed);
    s.deliverMessages(session);
  }
  if (s.phase == Impl::Phase::kFailed) session.refuse(s.failure);
  return !arrivals.empty();
}

void StaticSource::pick(std::uint32_t id, const glm::dvec3& origin, const glm::dvec3& direction) {
  lod::patch::Ray ray;
  ray.origin = origin - impl_->scene.welcome.origin;
  ray.direction = direction;
  impl_->picks.addRay(id, ray);
  impl_->pick_data_arrived = true;
}

std::vector<AnsweredPick> StaticSource::takePicks() {
  std::vector<AnsweredPick> answered = impl_->picks.takeAnswers();
  for (AnsweredPick& one : answered)
    if (one.answer.kind == PickAnswer::Kind::kHit) one.answer.point += impl_->scene.welcome.origin;
  return answered;
}

const std::string& StaticSource::problem() const {
  return impl_->failure.empty() ? impl_->problem : impl_->failure;
}

StaticStats StaticSource::stats() const {
  StaticStats stats = impl_->stats;
  stats.requests = impl_->queue.requestsSent();
  stats.bytes = impl_->queue.bytesReceived();
  stats.requests_under_way = static_cast<std::uint32_t>(impl_->queue.requestsUnderWay());
  return stats;
}

}  // namespace client
