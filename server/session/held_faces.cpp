#include "server/session/held_faces.h"

#include <utility>

namespace server {

HeldFaces::HeldFaces(std::shared_ptr<HeldMemory> memory)
    : memory_(memory ? std::move(memory) : std::make_shared<HeldMemory>()) {}

void HeldFaces::claim(const repository::FaceKey& key) {
  if (hasRoom())
    insert(key);
  else if (!contains(key))
    ++memory_->forgotten_;
}

void HeldFaces::add(const repository::FaceKey& key) {
  if (!hasRoom() && !contains(key)) {
    faces_.erase(faces_.begin());
    --memory_->faces_;
    ++memory_->forgotten_;
  }
  insert(key);
}

}  // namespace server
