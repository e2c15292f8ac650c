#pragma once
// Reads a published scene by byte ranges, without a server of ours, and acts as the server of a client::Session. It
// reads the records of groups and the image index as far as views need them, plans with plan/ as a server does,
// fetches, and hands the session the same messages. It has no socket, thread, clock or JSON: the platform brings a
// RangeFetcher, the time, and the values of scene.json. The formats are docs/formats/packs.md and records.md;
// docs/hosting.md says what a host must do.
//
// It reads, in this order:
//   1. what scene.json names for the first picture, the front of records-….lgr and blocks of patch-….lgp, some 25 kB,
//      and 4 KiB of index-….lgi, which make the Welcome
//   2. what the coarsest groups lack of records and blocks
//   3. what a picked ray needs (pick()); then the records that the view's cut leads to, groups in a server's order
//      (docs/formats/protocol.md), and with them the blocks of the index that tell of the plan's images, and once these
//      are here the images
//   4. when the view is complete: other directions, faces along the motion; at most 1 MB
// The newest view wins: what an older view wanted is not requested any more, requests under way are kept.
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <unordered_set>
#include <vector>

#include "base/byte_range.h"
#include "base/error.h"
#include "client/source/backoff.h"
#include "client/source/fetch.h"
#include "client/source/range_queue.h"
#include "client/source/ray_picks.h"
#include "client/source/session.h"
#include "lod/patch/group_records.h"
#include "lod/patch/traverse.h"
#include "plan/coarse_sight.h"
#include "plan/opening_ranges.h"
#include "plan/view_plan.h"
#include "repository/cache.h"
#include "repository/packs/pack_format.h"
#include "repository/sampling/sample_tree.h"

namespace client {

/// An object of the published scene, as scene.json names it.
struct StaticObject {
  std::string name;
  std::uint64_t bytes = 0;
  /// The ranges that the first picture needs, all asked for at once (plan/opening_ranges.h; of the index what lies
  /// before its blocks). The patches' are passed over where one of them cannot be.
  std::vector<base::FileRange> opening = {};
};

/// The values of scene.json (docs/formats/scene.md). They come from outside, and are checked before use.
struct StaticScene {
  std::string place;  ///< the scene's URL without scene.json, for error messages
  /// Filled in: scene_name, units, origin, box_min, box_max, up, unlit, shadows and light_direction. The files give the
  /// rest.
  protocol::Welcome welcome;
  StaticObject patches;               ///< patch-….lgp
  StaticObject records;               ///< records-….lgr
  std::optional<StaticObject> index;  ///< images/index-….lgi; absent where the scene has no images
};

/// Reads the grid and the sample tree from the text of an index's parameters (JSON, docs/formats/repository.md). Its
/// errors need not name the file.
using ReadParameters = std::function<base::Result<repository::SampledPoints>(const std::string& text)>;

struct StaticOptions {
  RangeQueueOptions queue;
  std::uint64_t index_cache_bytes = 8'000'000;  ///< decoded blocks of the index, kept by LRU
};

struct StaticStats {
  std::uint64_t requests = 0;      ///< sent
  std::uint64_t bytes = 0;         ///< received, records and index included
  std::uint64_t record_bytes = 0;  ///< part of `bytes`: records of groups
  std::uint64_t index_bytes = 0;   ///< part of `bytes`: blocks of the index
  std::uint64_t missing = 0;       ///< faces that the repository does not have
  std::uint64_t broken = 0;        ///< damaged faces, blocks of the index and groups
  std::uint32_t requests_under_way = 0;
  std::uint32_t wanted = 0;  ///< groups and faces that the newest view still lacks
};

class StaticSource {
 public:
  /// `fetcher` outlives it.
  StaticSource(StaticScene scene, RangeFetcher& fetcher, ReadParameters read_parameters,
               const StaticOptions& options = {});
  StaticSource(const StaticSource&) = delete;
  StaticSource& operator=(const StaticSource&) = delete;

  /// Takes in answers of the fetcher and messages of the session, hands the session what has arrived, and requests
  /// more. Never waits. `now`: seconds from any zero, never decreasing; failed requests are tried again after a pause.
  /// Returns true when something arrived.
  ///
  /// A host that does not answer leaves the session disconnected, with the reason, until it answers. A failure that
  /// cannot pass (no ranges, an object gone or changed, damaged tables) leaves it refused.
  bool pump(Session& session, double now);

  /// Asks where a ray first meets the full-resolution surface. World coordinates; `direction` has any length above 0.
  /// The leaf patches around the ray are read as far as the session does not hold them, and handed to it. pump() does
  /// the work; takePicks() returns the answer, kUnknown where damage or an unreadable scene prevents one.
  void pick(std::uint32_t id, const glm::dvec3& origin, const glm::dvec3& direction);
  /// Returns the answers since the last call, in world coordinates.
  std::vector<AnsweredPick> takePicks();

  /// The newest failure that leaves the rest of the scene usable, such as a lost pack, one line; else empty.
  const std::string& problem() const { return failure_.empty() ? problem_ : failure_; }
  StaticStats stats() const;

 private:
  using FaceKey = repository::FaceKey;
  using GroupRecords = lod::patch::GroupRecords;
  enum class Phase { kOpening, kOpen, kFailed };
  /// The kinds of RangeWish.
  enum Kind : std::uint32_t { kRecordFront, kOpening, kIndexFront, kChunk, kBlock, kIndexBlock, kFace };

  static base::Error badScene(const std::string& message) {
    return {base::ErrorCode::kInvalidInput, message + "; publish the scene again"};
  }
  base::Result<void> checkScene() const;
  void checkOpening();

  // ---- answers of the fetcher ----
  void acceptArrival(RangeArrival&& arrival);
  base::Result<void> acceptTable(const RangeArrival& arrival);
  base::Result<void> acceptRecordFront(base::ByteView bytes);
  base::Result<void> acceptIndexFront(base::ByteView bytes);
  void acceptChunk(std::uint32_t chunk, base::ByteView bytes);
  void acceptBlock(std::uint32_t group, base::ByteView bytes);
  void acceptIndexBlock(std::uint64_t number, base::ByteView bytes);
  void acceptFace(const FaceKey& key, base::Bytes bytes);
  void acceptFailure(const RangeArrival& arrival);
  void loseObject(const std::string& object, const std::string& why);
  void reportProblem(const std::string& message) { problem_ = message; }
  void fail(const std::string& why);

  // ---- messages from and to the session ----
  void readMessages(Session& session);
  void acceptMessage(const protocol::ClientMessage& message);
  void deliverMessages(Session& session);

  // ---- the hierarchy ----
  void openScene();
  bool readRecord(std::uint32_t group, std::vector<RangeWish>* wishes);
  void loseGroup(std::uint32_t group, const std::string& why);
  bool isKnown(std::uint32_t group) const { return group < hierarchy_.known.size() && hierarchy_.known[group] != 0; }
  RangeWish chunkWish(std::uint32_t chunk) const;
  RangeWish indexWish(std::uint64_t number) const;
  void wishForBlock(std::uint32_t group, std::vector<RangeWish>& wishes);

  void keepCoarseBlock(std::uint32_t group, const base::Bytes& block);
  void computeSight();

  // ---- the images ----
  enum class FaceState { kHere, kGone, kWanted };
  FaceState locateFace(const FaceKey& key, RangeWish& wish);
  bool settled(const FaceKey& key) const { return has_face_.count(key) != 0 || gone_.count(key) != 0; }

  // ---- the plan ----
  plan::Scene planScene();
  plan::Holdings holdings();
  std::optional<std::uint64_t> storedBytes(const FaceKey& key);
  void planNewestView();
  /// A group whose record is not here.
  struct UnknownGroup {
    std::uint32_t group = 0;
    float error_px = 0.0F;
    bool is_needed = true;  // by the shape; others bring no more than colours, and come after images
  };
  std::vector<UnknownGroup> frontierOf(const lod::patch::Cut& cut, const lod::patch::CutRequest& request);
  bool settled(std::uint32_t group) const { return has_group_[group] || broken_groups_.count(group) != 0; }
  std::vector<RangeWish> urgentWishes();
  bool wishForOpening(std::vector<RangeWish>& wishes) const;
  void wishForCoarse(std::vector<RangeWish>& wishes);
  bool wishForIndex(std::vector<RangeWish>& wishes);
  void wishForView(std::vector<RangeWish>& wishes);
  std::vector<RangeWish> prefetchWishes();

  // ---- picked rays ----
  void castPicks(Session& session);
  void wishForPick(std::vector<RangeWish>& wishes);

  StaticScene scene_;
  ReadParameters read_parameters_;
  StaticOptions options_;
  RangeQueue queue_;
  Phase phase_ = Phase::kOpening;
  std::string problem_, failure_;
  StaticStats stats_;

  // The link, as the session sees it.
  bool linked_ = false;       // the session was told connected()
  bool welcome_due_ = false;  // a Hello waits for its Welcome
  int failures_ = 0;          // consecutive ones
  std::string last_failure_;
  bool succeeded_ = false;  // since pump() began
  bool retry_set_ = false;
  Backoff backoff_;
  double retry_at_ = 0.0;
  struct OutgoingMessage {
    base::Bytes bytes;
    std::optional<FaceKey> face = {};
    std::optional<std::uint32_t> group = {};
  };
  std::deque<OutgoingMessage> outgoing_;

  // Data that were read.
  std::map<std::uint64_t, base::Bytes> opening_;  // range of the patches' `opening` -> its bytes
  std::optional<GroupRecords> records_;
  lod::patch::Hierarchy hierarchy_;  // the groups whose records were read
  std::unordered_set<std::uint32_t> broken_groups_;
  std::optional<repository::IndexRoot> root_;
  repository::SampledPoints points_;
  repository::LruCache<std::uint64_t, repository::IndexBlock> index_blocks_;
  std::unordered_set<std::uint64_t> broken_index_blocks_;
  std::unordered_set<std::string> lost_objects_;

  // Items that the session holds, and faces that cannot be had.
  std::vector<bool> has_group_;
  std::unordered_set<FaceKey> has_face_, gone_;
  std::vector<std::uint32_t> coarse_;

  // Blocks of the coarse groups, kept until the occlusion between them is computed, once, when all are here. In views
  // that are planned before nothing hides anything.
  std::vector<base::Bytes> coarse_blocks_;  // beside `coarse_`
  std::optional<lod::patch::ProxySight> sight_;
  bool sight_computed_ = false;

  // The views and their plan.
  std::optional<protocol::View> newest_, previous_;
  double newest_at_ = 0.0, previous_at_ = 0.0, now_ = 0.0;  // when they came, and the time of pump(), seconds
  bool planned_ = false, replan_ = false;
  bool coarse_is_here_ = false;
  std::unordered_set<std::uint64_t> index_wanted_;  // blocks of the newest plan's points, which are kept
  bool index_learned_ = false;                      // the index has told of more images since the plan was made
  plan::ViewPlan view_plan_;
  plan::ImageBytes image_bytes_;
  std::vector<UnknownGroup> frontier_;  // that the cut leads to
  bool complete_sent_ = false;
  std::optional<std::vector<FaceKey>> ahead_;

  RayPicks picks_;
  bool pick_data_arrived_ = false;  // data arrived that the first ray may need
};

}  // namespace client
