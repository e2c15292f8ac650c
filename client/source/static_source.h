#pragma once
// A published scene read by byte ranges, with no server of ours: plays the server's part for a client::Session. It
// reads the hierarchy's tables and the image index as far as views need them, plans with plan/ as a server does,
// fetches and hands the session the same messages. No socket, no thread, no clock, no JSON: the platform brings a
// RangeFetcher, the time, and what scene.json says. docs/formats/packs.md and patch.md are the formats; docs/hosting.md
// what a host must do.
//
// What is read, in order:
//   1. the first 16 KiB of patch-….lgp and of index-….lgi: Welcome
//   2. pages of the tables that group 0 and the next coarsest need, and their blocks: the first picture, some 50 kB
//   3. the tables: whole where they are small, else the pages that the view's cut leads to
//   4. what a picked ray needs (pick()); then groups and faces in a server's order (docs/formats/protocol.md); blocks
//      of the index when a face needs one
//   5. when the view is complete: the rest of small tables, other directions, faces along the motion; at most 1 MB
// The newest view wins: what an older one wanted is not asked for any more, what is under way is kept.
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

/// An object that scene.json names, with its length.
struct StaticObject {
  std::string name;
  std::uint64_t bytes = 0;
};

/// What scene.json says (docs/formats/scene.md), as plain values. Hostile: checked before use.
struct StaticScene {
  std::string place;  ///< the scene's URL without scene.json, for messages
  /// scene_name, units, origin, box_min, box_max, up, unlit and light_direction; the files tell the rest.
  protocol::Welcome welcome;
  StaticObject patches;               ///< patch-….lgp
  std::optional<StaticObject> index;  ///< images/index-….lgi; nothing: no images
};

/// Grid and tree from the text of an index's parameters (JSON; docs/formats/repository.md). Errors need not name the
/// file.
using ReadParameters = std::function<base::Result<repository::SampledPoints>(const std::string& text)>;

struct StaticOptions {
  RangeQueueOptions queue;
  std::uint64_t eager_table_bytes = 192 * 1024;  ///< tables up to this are read whole as soon as something is drawn
  std::uint64_t index_cache_bytes = 8'000'000;   ///< decoded blocks of the index, LRU
};

struct StaticStats {
  std::uint64_t requests = 0;     ///< sent
  std::uint64_t bytes = 0;        ///< received, tables and index among them
  std::uint64_t table_bytes = 0;  ///< of these, the hierarchy's tables
  std::uint64_t index_bytes = 0;  ///< ... blocks of the index
  std::uint64_t missing = 0;      ///< faces that the repository lacks
  std::uint64_t broken = 0;       ///< faces, blocks of the index and groups whose bytes are damaged
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

  /// Takes in what the fetcher has and what the session says, hands the session what is there, asks for more. Never
  /// waits. `now` in seconds, from any beginning, never falling: failed requests are tried again after a while. True
  /// when something came.
  ///
  /// A host that does not answer leaves the session disconnected, with the reason, until it does. What cannot pass (no
  /// ranges, an object gone or changed, damaged tables) leaves it refused.
  bool pump(Session& session, double now);

  /// Where the ray first meets the full-resolution surface, in world coordinates, `direction` of any length but zero:
  /// the leaf patches around it are read as far as the session does not hold them, and handed to it. pump() works on
  /// it; takePicks() has the answer, kUnknown where damage or a scene that cannot be read keeps it from being found.
  void pick(std::uint32_t id, const glm::dvec3& origin, const glm::dvec3& direction);
  /// What was found since the last call, world coordinates.
  std::vector<AnsweredPick> takePicks();

  /// What cannot be shown though the rest goes on, such as a lost pack: the newest such thing, one line; else empty.
  const std::string& problem() const;
  StaticStats stats() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace client
