#pragma once
// The images that a viewer holds, as far as the server remembers them, and the memory that they may take in all. An
// image that is not remembered is sent again when a view needs it: forgetting costs bytes, and nothing is ever missing.
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <unordered_set>

#include "repository/sampling/key.h"

namespace server {

/// As many faces may a client claim to hold, and are remembered of it: 512 MB of tiles. A cache of 50 MB holds some
/// 6 000.
inline constexpr std::size_t kMaxFacesHeld = 65'536;
/// As many are remembered of each viewer at least, whatever others hold: a view and what was prefetched for it.
inline constexpr std::size_t kMinFacesHeld = 1024;

/// Memory for what all viewers hold. Any thread.
class HeldMemory {
 public:
  static constexpr std::uint64_t kDefaultBytes = std::uint64_t{512} << 20;
  static constexpr std::uint64_t kFaceBytes = 56;  ///< measured, of std::unordered_set

  explicit HeldMemory(std::uint64_t max_bytes = kDefaultBytes) : max_faces_(max_bytes / kFaceBytes) {}
  std::uint64_t bytes() const { return kFaceBytes * faces_; }
  /// Faces that a viewer held and that were not remembered, or no longer.
  std::uint64_t forgotten() const { return forgotten_; }

 private:
  friend class HeldFaces;
  bool hasRoom() const { return faces_ < max_faces_; }
  /// Claims cost nothing, so that they get half of the room: whoever claims much without holding it leaves the other
  /// half to what is sent.
  bool hasRoomForClaims() const { return faces_ < max_faces_ / 2; }

  const std::uint64_t max_faces_;
  std::atomic<std::uint64_t> faces_{0}, forgotten_{0};
};

/// The faces of one viewer.
class HeldFaces {
 public:
  /// `memory`: null for one of its own.
  explicit HeldFaces(std::shared_ptr<HeldMemory> memory);
  ~HeldFaces() { memory_->faces_ -= faces_.size(); }
  HeldFaces(const HeldFaces&) = delete;
  HeldFaces& operator=(const HeldFaces&) = delete;

  bool contains(const repository::FaceKey& key) const { return faces_.count(key) != 0; }
  std::size_t size() const { return faces_.size(); }
  /// The viewer says that it holds the face. It is not remembered where there is no room.
  void claim(const repository::FaceKey& key);
  /// The face was sent. Where there is no room, another one of the viewer's is forgotten in its place.
  void add(const repository::FaceKey& key);
  void erase(const repository::FaceKey& key) { memory_->faces_ -= faces_.erase(key); }

 private:
  bool hasRoom(bool in_memory) const {
    return faces_.size() < kMinFacesHeld || (faces_.size() < kMaxFacesHeld && in_memory);
  }
  void forgetAnother();
  void insert(const repository::FaceKey& key) { memory_->faces_ += faces_.insert(key).second ? 1 : 0; }

  const std::shared_ptr<HeldMemory> memory_;
  std::unordered_set<repository::FaceKey> faces_;
  std::size_t next_bucket_ = 0;  // from which on the next one to be forgotten is looked for
};

}  // namespace server
