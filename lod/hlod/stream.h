#pragma once
// Streams a hlod.lgh node by node, in the order in which views need them. The class has no socket, clock or thread: it
// hands out byte ranges to request, takes their bytes, and is told the time.
//
// First come the header, the table and the root, then the nodes below it down to the cut that the view asks for, those
// first whose parents show the largest projected error. A node is drawn in place of its children until all of them that
// may be seen are here. Behind them come the casters of shadows, and last what other views near this one may want.
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "lod/byte_range.h"
#include "lod/file_bytes.h"
#include "lod/hlod/format.h"
#include "lod/hlod/prefetch.h"
#include "lod/hlod/traverse.h"
#include "lod/surface_vertex.h"

namespace lod::hlod {

inline constexpr std::uint64_t kMinStreamMemory = 1'000'000;

struct StreamOptions {
  /// Limit for blocks and decoded nodes together, besides the table; at least kMinStreamMemory. Nodes that no frame has
  /// used for the longest time are dropped; what a view needs beyond it stays coarse.
  std::uint64_t memory_bytes = 256'000'000;
  std::size_t max_requests = 64;              ///< under way at a time
  std::uint64_t max_request_bytes = 262'144;  ///< neighbouring blocks are joined up to this
  /// Triangles and points decoded for a frame, about; the rest waits for the next one. 0: no limit.
  std::uint64_t decode_per_frame = 0;
  /// Once a view has all that it wants, nodes that it would want if it moved a little are fetched, up to so many bytes
  /// a view (section 4.3), and to what the link carries in so many seconds; none where it carries less than
  /// prefetch_least_rate bytes a second.
  std::uint64_t prefetch_bytes = 0;
  double prefetch_seconds = 1e9;
  double prefetch_least_rate = 0.0;
};

using ByteRange = lod::ByteRange;

/// A node's picture, decoded; it never changes.
struct NodePicture {
  std::uint32_t node = 0;
  std::uint32_t points = 0;              ///< the first of the vertices are points
  std::vector<SurfaceVertex> vertices;   ///< points, then the vertices of triangles
  std::vector<std::uint32_t> triangles;  ///< three vertices each
  std::vector<std::uint32_t> edges;      ///< two vertices each: lines that cover cracks
  float error = 0.0F;                    ///< of the node, scene units
};

/// A node's caster, which throws its shadow, decoded; it never changes.
struct CasterPicture {
  std::uint32_t node = 0;
  std::vector<glm::vec3> positions;      ///< scene-local
  std::vector<std::uint32_t> triangles;  ///< three positions each
  float error = 0.0F;                    ///< caster_error of the node, scene units
};

struct DrawnNode {
  float error_px = 0.0F;                       ///< projectedError() of the node
  bool awaits_finer = false;                   ///< finer nodes are wanted, and not here yet
  std::shared_ptr<const NodePicture> picture;  ///< not null
};

struct StreamStats {
  std::uint64_t nodes = 0, present = 0;  ///< nodes of the file; nodes decoded
  /// Nodes of the last view; those of them that await finer ones, and casters of it that are not here.
  std::uint64_t drawn = 0, lacking = 0;
  std::uint64_t bytes_received = 0;  ///< unusable answers included
  std::uint64_t memory_bytes = 0;    ///< blocks, decoded nodes and table
  std::uint64_t requests = 0, failures = 0;
  std::uint64_t under_way = 0;  ///< requests that have no answer yet
  std::uint64_t damaged = 0;    ///< blocks that came damaged three times and were given up
  std::uint64_t prefetched_bytes = 0;
  /// How often a view wanted a node that the one before did not: those that were here, and those that were not.
  std::uint64_t hits = 0, misses = 0;
};

class Stream {
 public:
  /// `file_bytes`: length of the file, as scene.json has it.
  Stream(std::uint64_t file_bytes, const StreamOptions& options);
  /// Reads a file that is on this machine: nothing is requested. Not null.
  Stream(std::shared_ptr<const FileBytes> file, const StreamOptions& options);
  ~Stream();

  /// Null until header and table have arrived.
  const Header* header() const;
  std::span<const Node> nodes() const;

  /// Changes StreamOptions::memory_bytes from the next update() on.
  void setMemory(std::uint64_t bytes);

  // ---- frames ----

  /// Finds the nodes to draw from what is here, decoding as much as a frame may, and queues what is missing in place of
  /// what earlier frames queued. `result` is replaced: front to back. Finds nothing before header(). `frames`: how many
  /// frames' share may be decoded, for views that are drawn less often.
  void update(const TraverseRequest& request, std::vector<DrawnNode>& result, std::uint32_t frames = 1);
  /// Finds casters of the wanted nodes for the view of the last update(), decoding what that has left of a frame's
  /// share, and queues what is missing behind the pictures that the view lacks. Calls behind one update() add up, as
  /// one for each map. In place of those that are not here comes the caster of the nearest node above that is, each
  /// once. `result` is replaced; casters without triangles are left out. A quarter of the memory is theirs while any
  /// are asked for.
  void updateCasters(std::span<const std::uint32_t> wanted, std::vector<std::shared_ptr<const CasterPicture>>& result);
  /// Names the maps that casters are drawn into, so that those that they would want if the light or the view moved a
  /// little are fetched ahead, as pictures are. They hold until others are named.
  void expectLights(std::vector<LightRequest> lights);
  /// Rises when another update() of the same view may find more.
  std::uint64_t generation() const;
  /// Whether the last update(), and all of updateCasters() behind it, had what they asked for that can be had.
  bool complete() const;
  /// Whether blocks that are here wait to be decoded for the last view.
  bool decoding() const;
  /// Whether memory kept the last view coarser than it asked for.
  bool limitedByMemory() const;

  // ---- the link ----

  /// Returns the ranges to request now; each must be answered by acceptAnswer() or acceptFailure(). A byte is never
  /// requested while it is under way. Returns nothing once there is a problem().
  std::vector<ByteRange> nextRequests(double now);
  /// Takes all the bytes of a range. Each block is checked by itself; damaged ones are requested again, at most twice.
  void acceptAnswer(std::uint64_t id, base::ByteView bytes, double now);
  /// The range was not answered: it is requested again if still wanted, after a pause that grows.
  void acceptFailure(std::uint64_t id, double now);
  /// Stops requesting for good. `reason`: one line.
  void giveUp(std::string reason);
  /// Why the stream has stopped, one line; empty when all is well.
  const std::string& problem() const;
  /// Names damaged nodes that were given up, in one line; empty when there are none.
  std::string warning() const;
  StreamStats stats() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace lod::hlod
