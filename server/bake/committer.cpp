#include "server/bake/committer.h"

#include <algorithm>
#include <iterator>

#include "base/check.h"

namespace server {

Committer::Committer(repository::Store& store, std::uint32_t batch_faces, std::uint64_t window)
    : store_(store),
      batch_faces_(batch_faces),
      window_(window),
      thread_([this](const std::stop_token& stop) { runThread(stop); }) {
  LUMIGRID_CHECK_LT(batch_faces, window);
}

bool Committer::waitForRoom(std::uint64_t sequence) {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return error_ || sequence < committed_ + window_; });
  return !error_;
}

void Committer::deliver(std::uint64_t sequence, const repository::FaceKey& key, std::vector<EncodedTile> tiles) {
  Batch values;
  for (EncodedTile& tile : tiles) {
    repository::FaceKey tile_key = key.face();
    tile_key.tile = tile.tile;
    values.emplace_back(tile_key, std::move(tile.value));
  }
  const std::lock_guard lock(mutex_);
  waiting_.emplace(sequence, std::move(values));
  changed_.notify_all();
}

void Committer::fail(base::Error error) {
  const std::lock_guard lock(mutex_);
  if (!error_) error_ = std::move(error);
  changed_.notify_all();
}

base::Result<void> Committer::finish() {
  {
    const std::lock_guard lock(mutex_);
    finishing_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
  if (error_) return *error_;
  return {};
}

// Whether a whole batch without a gap is there; while finishing, anything is a batch.
bool Committer::batchReady() const {
  if (waiting_.empty()) return false;
  if (finishing_) return true;
  return waiting_.size() >= batch_faces_ &&
         std::next(waiting_.begin(), batch_faces_ - 1)->first == batched_ + batch_faces_ - 1;
}

std::pair<Committer::Batch, std::uint32_t> Committer::nextBatch() {
  Batch batch;
  std::uint32_t faces = 0;
  for (; !waiting_.empty() && faces < batch_faces_; ++faces) {
    std::move(waiting_.begin()->second.begin(), waiting_.begin()->second.end(), std::back_inserter(batch));
    waiting_.erase(waiting_.begin());
  }
  batched_ += faces;
  return {std::move(batch), faces};
}

void Committer::runThread(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait(lock, stop, [&] { return error_ || batchReady() || finishing_; });
    if (stop.stop_requested() || error_ || !batchReady()) return;

    // The store waits for the disk, so the lock is released meanwhile.
    const auto [batch, faces] = nextBatch();
    lock.unlock();
    const base::Result<void> put = store_.putBatch(batch);
    lock.lock();
    if (!put && !error_) error_ = put.error();
    if (put) committed_ += faces;
    changed_.notify_all();
  }
}

}  // namespace server
