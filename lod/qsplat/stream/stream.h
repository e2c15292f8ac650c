#pragma once
// A qsplat.lgq that comes piece by piece, in the order in which a view has use for it (Rusinkiewicz and Levoy 2001,
// sections 3 and 4). No socket, no clock, no thread: byte ranges to ask for go out, bytes come in, the time is told.
//
// A user's loop:
//   stream.traverse(request, result);                      // for each frame: what to draw; what it lacks is queued
//   for (const ByteRange& range : stream.requests(now)) …  // as often as answers come: send these
//   stream.received(id, bytes, now) or stream.failed(id, now)
//
// A file in either form may come: what is asked for and comes is a coded file's coded blocks, all else is of blocks as
// they are in the plain form.
//
// In place of the paper's temporary file, blocks are kept in memory up to a number of bytes; the ones that no frame
// has looked into for the longest time go. What this frame looked into stays, so a drawn cut never loses a block.
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "base/bytes.h"
#include "lod/qsplat/blocks.h"
#include "lod/qsplat/stream/availability.h"
#include "lod/qsplat/stream/link_estimate.h"
#include "lod/qsplat/stream/order.h"
#include "lod/qsplat/stream/request_queue.h"
#include "lod/qsplat/traverse.h"

namespace lod::qsplat {

inline constexpr std::uint64_t kMinStreamMemory = 64 * 1024;
/// A file may have this many times StreamOptions::memory_bytes, in the plain form: tables have 13 bytes for each of its
/// blocks, 21 in the coded one.
inline constexpr std::uint64_t kMaxFilePerMemory = 64;

struct StreamOptions {
  std::uint64_t memory_bytes = 128'000'000;  ///< blocks kept at most; at least kMinStreamMemory
  /// Under way. More than the six connections that browsers open to a host: the next ones are there when a frame was
  /// long in coming.
  std::size_t most_requests = 16;
  std::uint64_t most_request_blocks = 128;  ///< joined into one range, at least 1
  StreamOrder order = StreamOrder::kSweeps;
  /// Fetched for each view when it has all that it wants: first what is near it, then the file from its front. Only as
  /// far as memory is free. 0: nothing.
  std::uint64_t idle_bytes = 16'000'000;
};

/// Bytes offset … offset + length − 1 of the file.
struct ByteRange {
  std::uint64_t id = 0;
  std::uint64_t offset = 0;
  std::uint64_t length = 0;
};

struct StreamStats {
  std::uint64_t blocks = 0;  ///< of the file, header included
  std::uint64_t present = 0, requested = 0, wanted = 0;
  std::uint64_t given_up = 0;        ///< came damaged again and again
  std::uint64_t bytes_received = 0;  ///< what did not belong there included
  std::uint64_t memory_bytes = 0;    ///< of the blocks that are kept, and of tables
  std::uint64_t evicted = 0;         ///< blocks
  std::uint64_t requests = 0;        ///< sent
  std::uint64_t failures = 0;        ///< answers that failed, or held damaged blocks
  double bytes_per_second = 0.0;     ///< estimated
};

class Stream {
 public:
  /// `file_bytes`: of the whole file, as somebody says who knows (scene.json). What cannot be is a problem().
  Stream(std::uint64_t file_bytes, const StreamOptions& options);

  /// Null until the front of the file is here.
  const Header* header() const { return blocks_ ? &blocks_->header() : nullptr; }

  // ---- frames ----

  /// What to draw of what is here. `request`'s priority and lens are not looked at; what is lacking is queued by the
  /// stream's order, after all that earlier frames wanted was forgotten. Nothing is drawn before header().
  void traverse(const TraverseRequest& request, const std::optional<Lens>& lens, Traversal& result);
  /// Counts up when another traversal of the same view may find more.
  std::uint64_t generation() const { return generation_; }
  /// The last frame lacks nothing that can be had: no damaged blocks, nothing beyond the memory.
  bool complete() const;
  /// Memory keeps the last frame from being finer.
  bool limited() const { return limited_; }

  // ---- the link ----

  /// What to ask for now; each is to be answered by received() or failed(). A byte is never asked for while it is under
  /// way. Empty when problem() says why.
  std::vector<ByteRange> requests(double now);
  /// All the bytes of a range. Each block is checked by itself: good ones stay, damaged ones are asked for again, at
  /// most twice. What is not as long as the range is a failure.
  void received(std::uint64_t id, base::ByteView bytes, double now);
  /// No answer, or one that broke off: all of its blocks are asked for again, if they are wanted still, after a pause
  /// that grows from failure to failure.
  void failed(std::uint64_t id, double now);
  /// Nothing can come any more; the reason, one line.
  void giveUp(std::string reason);
  /// Why nothing comes any more: the file is none of ours, has another length, is too large for the memory, contradicts
  /// itself, or giveUp(). Empty when all is well. What was drawn before stays right.
  const std::string& problem() const { return problem_; }
  /// Damaged blocks that were given up, one line; empty when there are none. Coarser splats stand in for them.
  std::string warning() const;

  StreamStats stats() const;
  /// Of the bytes received, those that no frame has looked into. Goes through all blocks.
  std::uint64_t bytesWasted() const;

 private:
  struct Held {
    std::unique_ptr<std::uint8_t[]> bytes;
    std::uint32_t arrived = 0;  ///< after this frame
  };
  struct UnderWay {
    BlockRun run;  ///< first 0: the file's front, whatever it turns out to hold
    std::uint64_t bytes = 0;
    double sent_at = 0.0;
  };

  void queueWanted(const std::vector<WantedBlock>& wanted);
  bool isGivenUp(std::uint64_t number) const;

  BlockRun next(std::uint64_t most);
  BlockRun nextIdle(std::uint64_t most);
  BlockRun nextFromFront(std::uint64_t most);
  ByteRange send(const BlockRun& run, double now);
  void giveUpForMemory(std::uint64_t plain_bytes);
  CodedPlace placeOf(std::uint64_t number) const;
  std::uint64_t typicalBlockBytes() const;
  BlockRun sideBySide(const BlockRun& run);
  bool takeFront(base::ByteView bytes);
  bool takeHeader(base::ByteView front);
  void takeBlocks(const BlockRun& run, base::ByteView bytes, bool& all_good);
  bool takeBlock(std::uint64_t number, base::ByteView stored);
  bool decode(std::uint64_t number, base::ByteView stored, std::uint8_t* plain);
  bool keep(std::uint64_t number, std::unique_ptr<std::uint8_t[]> plain);
  void pauseAfterFailure(double sent_at, double now);

  std::uint64_t freeBlocks() const;
  std::uint64_t blocksInUse();
  std::uint32_t lastUse(std::uint64_t number, const Held& held) const;
  bool wasDrawn(std::uint64_t number, const Held& held) const;
  bool makeRoom();
  void drop(std::uint64_t number);

  const StreamOptions options_;
  const std::uint64_t file_bytes_;
  const std::uint64_t most_held_;  ///< blocks
  Availability availability_;
  RequestQueue queue_;
  LinkEstimate link_;
  std::unique_ptr<GrowingBlocks> blocks_;
  std::unique_ptr<BlockCoder> coder_;   ///< of a coded file, and …
  std::unique_ptr<PlaceTable> places_;  ///< … where its blocks are
  std::unordered_map<std::uint64_t, Held> held_;
  std::map<std::uint64_t, UnderWay> under_way_;
  std::uint64_t blocks_under_way_ = 0;
  std::unordered_map<std::uint64_t, int> damages_;  ///< how often a block came damaged

  std::uint32_t frame_ = 0;
  std::uint64_t generation_ = 0;
  std::uint64_t lacking_ = 0;  ///< blocks that the last frame wanted and that can still be had
  bool limited_ = false;
  std::optional<std::uint64_t> in_use_;  ///< blocks, of this frame; none: not counted yet

  // At rest.
  TraverseRequest view_;  ///< of the last frame
  Traversal nearby_;
  bool idle_ = false;                    ///< what is queued is for later
  std::uint64_t nearby_generation_ = 0;  ///< of nearby_; 0: none of this view
  std::uint64_t arrivals_ = 1;           ///< blocks and failures
  std::uint64_t idle_left_ = 0;          ///< blocks
  std::uint64_t front_to_back_ = 0;

  double pause_until_ = -1e300;
  double paused_at_ = -1e300;  ///< when that pause began
  int failures_in_a_row_ = 0;
  std::string problem_;
  StreamStats counted_;
  std::uint64_t wasted_ = 0;  ///< bytes that are not kept
};

}  // namespace lod::qsplat
