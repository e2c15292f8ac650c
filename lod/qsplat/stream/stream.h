#pragma once
// Streams a qsplat.lgq block by block, in the order in which views need the blocks (Rusinkiewicz and Levoy 2001,
// sections 3 and 4). The class has no socket, clock or thread: it hands out byte ranges to request, takes their bytes,
// and is told the time.
//
// A user's loop:
//   stream.traverse(request, lens, result);                    // each frame: finds splats, queues missing blocks
//   for (const ByteRange& range : stream.nextRequests(now)) …  // each frame and after each answer: send these
//   stream.acceptAnswer(id, bytes, now);                       // or stream.acceptFailure(id, now)
//
// Files of both forms can be streamed. Requests and answers are in bytes of the file as it is stored; everything else
// counts blocks of the plain form.
//
// In place of the paper's temporary file, blocks are kept in memory up to a number of bytes; those that no frame has
// used for the longest time are evicted. Blocks that the current frame used stay, so a drawn cut never loses one.
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/bytes.h"
#include "lod/link_estimate.h"
#include "lod/qsplat/blocks.h"
#include "lod/qsplat/stream/request_queue.h"
#include "lod/qsplat/traverse.h"

namespace lod::qsplat {

inline constexpr std::uint64_t kMinStreamMemory = 64 * 1024;
/// A file may have at most this many times StreamOptions::memory_bytes, counted in the plain form: the stream's tables
/// take 13 bytes for each of its blocks, 21 where the file is coded.
inline constexpr std::uint64_t kMaxFilePerMemory = 64;

/// The five orders of the paper in which the blocks of a view are fetched (sections 4.2 and 4.3).
enum class StreamOrder {
  kLevel,    ///< 1: by level in the tree
  kRadius,   ///< 2: by radius in the scene, largest first
  kSize,     ///< 3: by size on the screen, largest first
  kTopDown,  ///< 4: from the screen's top to its bottom, whatever the size
  kSweeps,   ///< 5: sweepPriority, the paper's choice
};
inline constexpr std::array<std::pair<StreamOrder, std::string_view>, 5> kStreamOrderNames{
    {{StreamOrder::kLevel, "level"},
     {StreamOrder::kRadius, "radius"},
     {StreamOrder::kSize, "size"},
     {StreamOrder::kTopDown, "rows"},
     {StreamOrder::kSweeps, "sweeps"}}};
std::optional<StreamOrder> streamOrderFromName(std::string_view name);

struct StreamOptions {
  std::uint64_t memory_bytes = 128'000'000;  ///< limit for the blocks that are kept; at least kMinStreamMemory
  /// Requests under way at a time. More than the six connections that browsers open to a host, so that the next ones
  /// wait in the browser when a frame takes long.
  std::size_t max_requests = 16;
  std::uint64_t max_request_blocks = 128;  ///< blocks joined into one range, at least 1
  StreamOrder order = StreamOrder::kSweeps;
  /// Bytes fetched ahead for each view once it is complete: first its surroundings, then the file from its front, as
  /// far as memory is free. 0: nothing.
  std::uint64_t idle_bytes = 16'000'000;
};

/// Bytes offset … offset + length − 1 of the stored file.
struct ByteRange {
  std::uint64_t id = 0;
  std::uint64_t offset = 0;
  std::uint64_t length = 0;
};

struct StreamStats {
  std::uint64_t blocks = 0;                              ///< blocks of the file, header included
  std::uint64_t present = 0, requested = 0, wanted = 0;  ///< blocks
  std::uint64_t given_up = 0;                            ///< blocks that came damaged kMaxDamages times
  std::uint64_t bytes_received = 0;                      ///< unusable answers included
  std::uint64_t memory_bytes = 0;                        ///< memory of kept blocks and tables
  std::uint64_t evicted = 0;                             ///< blocks
  std::uint64_t requests = 0;                            ///< sent
  std::uint64_t failures = 0;                            ///< answers that failed, or held damaged blocks
  double bytes_per_second = 0.0;                         ///< estimated
};

class Stream {
 public:
  /// `file_bytes`: length of the stored file, as scene.json has it. An impossible length becomes a problem().
  Stream(std::uint64_t file_bytes, const StreamOptions& options);
  /// Takes a whole file that is on this machine, such as a mapped one: nothing is requested, and no memory limit holds
  /// for a plain file. Not null.
  Stream(std::shared_ptr<FileBlocks> file, const StreamOptions& options);

  /// Returns null until the front of the file has arrived.
  const Header* header() const { return blocks() != nullptr ? &blocks()->header() : nullptr; }

  // ---- frames ----

  /// Finds the splats to draw with the blocks that are present, and queues the missing ones by the stream's order in
  /// place of those that earlier frames queued. `request`'s priority and lens are ignored. Finds nothing before
  /// header().
  void traverse(const TraverseRequest& request, const std::optional<Lens>& lens, Traversal& result);
  /// Rises when another traversal of the same view may find more.
  std::uint64_t generation() const { return generation_; }
  /// Whether the last frame has all blocks that it can get: damaged blocks and those beyond the memory don't count.
  bool complete() const;
  /// Whether the last frame would be finer if there were more memory.
  bool limitedByMemory() const { return limited_; }

  // ---- the link ----

  /// Returns the ranges to request now; each must be answered by acceptAnswer() or acceptFailure(). A byte is never
  /// requested while it is under way. Returns nothing once there is a problem().
  std::vector<ByteRange> nextRequests(double now);
  /// Takes all the bytes of a range. Each block is checked by itself: intact ones are kept, damaged ones are requested
  /// again, at most twice. An answer of another length than the range counts as a failure.
  void acceptAnswer(std::uint64_t id, base::ByteView bytes, double now);
  /// The range was not answered, or the answer broke off: its blocks are requested again if they are still wanted,
  /// after a pause that grows from failure to failure.
  void acceptFailure(std::uint64_t id, double now);
  /// Stops requesting for good. `reason`: one line.
  void giveUp(std::string reason);
  /// Returns why the stream has stopped: the file is no qsplat.lgq, has another length, is too large for the memory,
  /// contradicts itself, or giveUp() was called. Empty when all is well. Splats found before stay valid.
  const std::string& problem() const { return problem_; }
  /// Names damaged blocks that were given up, in one line; empty when there are none. Coarser splats replace them.
  std::string warning() const;

  StreamStats stats() const;
  /// Returns how many of the received bytes no frame has used. Visits all blocks.
  std::uint64_t bytesWasted() const;

 private:
  struct KeptBlock {
    std::unique_ptr<std::uint8_t[]> bytes;
    std::uint32_t arrived = 0;  ///< the frame before its arrival
  };
  struct PendingRequest {
    BlockRun run;  ///< first 0: the file's front, however many blocks that turns out to contain
    std::uint64_t bytes = 0;
    double sent_at = 0.0;
  };

  /// Null until the front of the file has arrived.
  Blocks* blocks() const { return whole_ ? static_cast<Blocks*>(whole_.get()) : blocks_.get(); }
  void queueWanted(const std::vector<WantedBlock>& wanted);
  bool isGivenUp(std::uint64_t number) const;

  BlockRun nextRun(std::uint64_t max_blocks);
  BlockRun nextIdleRun(std::uint64_t max_blocks);
  BlockRun nextRunFromFront(std::uint64_t max_blocks);
  ByteRange addRequest(const BlockRun& run, double now);
  void giveUpForMemory(std::uint64_t plain_bytes);
  CodedPlace placeOf(std::uint64_t number) const;
  std::uint64_t typicalBlockBytes() const;
  BlockRun checkedRun(const BlockRun& run);
  bool acceptFront(base::ByteView bytes);
  bool acceptHeader(base::ByteView front);
  bool acceptBlocks(const BlockRun& run, base::ByteView bytes);
  bool acceptBlock(std::uint64_t number, base::ByteView stored);
  bool decodeBlock(std::uint64_t number, base::ByteView stored, std::uint8_t* plain);
  bool keepBlock(std::uint64_t number, std::unique_ptr<std::uint8_t[]> plain);
  void pauseAfterFailure(double sent_at, double now);

  std::uint64_t freeBlocks() const;
  std::uint64_t blocksInUse();
  std::uint32_t lastUse(std::uint64_t number, const KeptBlock& kept) const;
  bool wasUsed(std::uint64_t number, const KeptBlock& kept) const;
  bool evictUnused();
  void dropBlock(std::uint64_t number);

  const StreamOptions options_;
  const std::uint64_t file_bytes_;
  const std::uint64_t max_kept_;  ///< blocks
  Availability availability_;
  RequestQueue queue_;
  LinkEstimate link_;
  const std::shared_ptr<FileBlocks> whole_;  ///< null where the file is streamed
  std::unique_ptr<GrowingBlocks> blocks_;
  std::unique_ptr<BlockCoder> coder_;                  ///< null for a plain file
  std::unique_ptr<PlaceTable> places_;                 ///< where a coded file's blocks lie
  std::unordered_map<std::uint64_t, KeptBlock> kept_;  ///< by number
  std::map<std::uint64_t, PendingRequest> under_way_;  ///< by id
  std::uint64_t blocks_under_way_ = 0;
  std::unordered_map<std::uint64_t, int> damages_;  ///< how often a block came damaged

  std::uint32_t frame_ = 0;
  std::uint64_t generation_ = 0;
  std::uint64_t lacking_ = 0;  ///< missing blocks of the last frame that were not given up
  bool limited_ = false;
  std::optional<std::uint64_t> in_use_;  ///< kept blocks that this frame uses; none: not counted yet

  // These fetch ahead while the view rests.
  TraverseRequest view_;  ///< the request of the last frame
  Traversal nearby_;
  bool idle_ = false;                  ///< the queue contains blocks of the surroundings
  std::uint64_t nearby_arrivals_ = 0;  ///< arrivals_ when nearby_ was found; 0: not for this view
  std::uint64_t arrivals_ = 1;         ///< answers and failures
  std::uint64_t idle_left_ = 0;        ///< blocks that may still be fetched ahead
  std::uint64_t front_to_back_ = 0;    ///< blocks before this one are not absent

  double pause_until_ = -1e300;
  double paused_at_ = -1e300;  ///< begin of that pause
  int failures_in_a_row_ = 0;
  std::string problem_;
  StreamStats counted_;
  std::uint64_t wasted_ = 0;  ///< bytes that were dropped unused
};

}  // namespace lod::qsplat
