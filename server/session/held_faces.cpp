#include "server/session/held_faces.h"

#include <utility>

namespace server {

HeldFaces::HeldFaces(std::shared_ptr<HeldMemory> memory)
    : memory_(memory ? std::move(memory) : std::make_shared<HeldMemory>()) {}

void HeldFaces::claim(const repository::FaceKey& key) {
  if (hasRoom(memory_->hasRoomForClaims()))
    insert(key);
  else if (!contains(key))
    ++memory_->forgotten_;
}

void HeldFaces::add(const repository::FaceKey& key) {
  if (!hasRoom(memory_->hasRoom()) && !contains(key)) forgetAnother();
  insert(key);
}

/// Goes round the buckets, since the set's first element is often the one that was added last: faces of a view would
/// then be forgotten for each other, and sent again for ever.
void HeldFaces::forgetAnother() {
  const std::size_t buckets = faces_.bucket_count();
  do next_bucket_ = (next_bucket_ + 1) % buckets;
  while (faces_.bucket_size(next_bucket_) == 0);
  faces_.erase(repository::FaceKey(*faces_.begin(next_bucket_)));
  --memory_->faces_;
  ++memory_->forgotten_;
}

}  // namespace server
