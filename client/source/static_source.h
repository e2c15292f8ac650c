#pragma once
// Reads a published scene by byte ranges, without a server of ours, and acts as the server of a client::Session. It
// reads the hierarchy's tables and the image index as far as views need them, plans with plan/ as a server does,
// fetches, and hands the session the same messages. It has no socket, thread, clock or JSON: the platform brings a
// RangeFetcher, the time, and the values of scene.json. The formats are docs/formats/packs.md and patch.md;
// docs/hosting.md says what a host must do.
//
// It reads, in this order:
//   1. the first 16 KiB of patch-….lgp and of index-….lgi, which make the Welcome
//   2. the table pages that group 0 and the next coarsest groups need, and their blocks: the first picture, some 50 kB
//   3. the tables: whole where they are small, else the pages that the view's cut leads to
//   4. what a picked ray needs (pick()); then groups and faces in a server's order (docs/formats/protocol.md), and
//      blocks of the index when a face needs one
//   5. when the view is complete: the rest of small tables, other directions, faces along the motion; at most 1 MB
// The newest view wins: what an older view wanted is not requested any more, requests under way are kept.
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "base/error.h"
#include "client/source/fetch.h"
#include "client/source/range_queue.h"
#include "client/source/ray_picks.h"
#include "client/source/session.h"
#include "repository/sampling/sample_tree.h"

namespace client {

/// An object of the published scene, as scene.json names it.
struct StaticObject {
  std::string name;
  std::uint64_t bytes = 0;
};

/// The values of scene.json (docs/formats/scene.md). They come from outside, and are checked before use.
struct StaticScene {
  std::string place;  ///< the scene's URL without scene.json, for error messages
  /// Filled in: scene_name, units, origin, box_min, box_max, up, unlit and light_direction. The files give the rest.
  protocol::Welcome welcome;
  StaticObject patches;               ///< patch-….lgp
  std::optional<StaticObject> index;  ///< images/index-….lgi; absent where the scene has no images
};

/// Reads the grid and the sample tree from the text of an index's parameters (JSON, docs/formats/repository.md). Its
/// errors need not name the file.
using ReadParameters = std::function<base::Result<repository::SampledPoints>(const std::string& text)>;

struct StaticOptions {
  RangeQueueOptions queue;
  std::uint64_t eager_table_bytes =
      192 * 1024;                               ///< tables up to this size are read whole as soon as something is drawn
  std::uint64_t index_cache_bytes = 8'000'000;  ///< decoded blocks of the index, kept by LRU
};

struct StaticStats {
  std::uint64_t requests = 0;     ///< sent
  std::uint64_t bytes = 0;        ///< received, tables and index included
  std::uint64_t table_bytes = 0;  ///< part of `bytes`: the hierarchy's tables
  std::uint64_t index_bytes = 0;  ///< part of `bytes`: blocks of the index
  std::uint64_t missing = 0;      ///< faces that the repository does not have
  std::uint64_t broken = 0;       ///< damaged faces, blocks of the index and groups
  std::uint32_t requests_under_way = 0;
  std::uint32_t wanted = 0;  ///< groups and faces that the newest view still lacks
};

class StaticSource {
 public:
  /// `fetcher` outlives it.
  StaticSource(StaticScene scene, RangeFetcher& fetcher, ReadParameters read_parameters,
               const StaticOptions& options = {});
  ~StaticSource();
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
  const std::string& problem() const;
  StaticStats stats() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace client
