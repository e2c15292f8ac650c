#pragma once
// The Committer receives encoded faces from many threads in any order and commits them in batches, in the order of
// their numbers, on a thread of its own. So drawing, reading back, encoding and committing overlap, and the store
// always holds a beginning of the work.
#include <condition_variable>
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "base/error.h"
#include "repository/store.h"
#include "server/bake/face_encoder.h"

namespace server {

/// Its end without finish() drops what is not committed.
class Committer {
 public:
  /// `window`: faces that may be under way between waitForRoom() and the store; more than batch_faces.
  Committer(repository::Store& store, std::uint32_t batch_faces, std::uint64_t window);

  /// Blocks until face number `sequence` (0, 1, 2 … without a gap) may be started. False when the work has failed:
  /// stop.
  bool waitForRoom(std::uint64_t sequence);
  /// Hands over the encoded face `sequence`, whose tiles are committed together. From any thread; never blocks for
  /// long.
  void deliver(std::uint64_t sequence, const repository::FaceKey& key, std::vector<EncodedTile> tiles);
  /// Ends the work with an error from elsewhere; the first error stays.
  void fail(base::Error error);
  /// Commits what was delivered and returns the first error, if any.
  base::Result<void> finish();

 private:
  void runThread(const std::stop_token& stop);
  /// The values of some faces.
  using Batch = std::vector<std::pair<repository::FaceKey, base::Bytes>>;

  /// Takes the next faces, and tells how many they are.
  std::pair<Batch, std::uint32_t> nextBatch();
  bool batchReady() const;

  repository::Store& store_;
  const std::uint32_t batch_faces_;
  const std::uint64_t window_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::map<std::uint64_t, Batch> waiting_;  // by sequence number
  std::uint64_t batched_ = 0;               // faces below this number are in a batch …
  std::uint64_t committed_ = 0;             // … and below this one in the store
  bool finishing_ = false;
  std::optional<base::Error> error_;
  std::jthread thread_;  // last: it uses the others
};

}  // namespace server
