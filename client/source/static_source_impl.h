#pragma once
// The members and private functions of client::StaticSource: it takes answers in (static_answers.cpp), decides what to
// request next (static_wishes.cpp), and talks to the session (static_source.cpp). Only these three files include it.
#include <deque>
#include <optional>
#include <string>
#include <unordered_set>
#include <utility>
#include <vector>

#include "client/source/static_source.h"
#include "lod/patch/table_pages.h"
#include "lod/patch/traverse.h"
#include "plan/coarse_sight.h"
#include "plan/view_plan.h"
#include "repository/cache.h"
#include "repository/packs/pack_format.h"

namespace client {

struct StaticSource::Impl {
  using FaceKey = repository::FaceKey;
  using TablePages = lod::patch::TablePages;
  enum class Phase { kOpening, kOpen, kFailed };
  /// The kinds of RangeWish.
  enum Kind : std::uint32_t { kPatchFront, kIndexFront, kParameters, kPage, kBlock, kIndexBlock, kFace };

  Impl(StaticScene published, RangeFetcher& fetcher, ReadParameters reader, const StaticOptions& wanted)
      : scene(std::move(published)),
        read_parameters(std::move(reader)),
        options(wanted),
        queue(fetcher, wanted.queue),
        index_blocks(wanted.index_cache_bytes) {
    if (auto sound = checkScene(); !sound) fail(scene.place + ": " + sound.error().message);
  }

  static base::Error badScene(const std::string& message) {
    return {base::ErrorCode::kInvalidInput, message + "; publish the scene again"};
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
  void reportProblem(const std::string& message) { problem = message; }
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
  struct OutgoingMessage {
    base::Bytes bytes;
    std::optional<FaceKey> face = {};
    std::optional<std::uint32_t> group = {};
  };
  std::deque<OutgoingMessage> outgoing;

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

}  // namespace client
