#pragma once
// Keeps on the GPU the decoded pictures that views draw: the leaves of a pmr.lgm, the nodes of a hlod.lgh.
#include <algorithm>
#include <cstdint>
#include <memory>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

namespace lod::draw {

/// `Mesh`: a picture on the GPU, with its bytes there as member `bytes`. Pictures are uploaded when first drawn. Those
/// that nobody holds any more are dropped with the next frame, and those that no frame has used for the longest time
/// where the limit asks for it. Needs a current context.
template <class Picture, class Mesh>
class PictureCache {
 public:
  /// `limit`: bytes; the pictures of the frame that is being drawn stay in any case.
  explicit PictureCache(std::uint64_t limit) : limit_(limit) {}

  /// Begins a frame: uploads the pictures that are not on the GPU yet, and drops others. `drawn` have a shared_ptr
  /// `picture`, which is not null; `upload` makes a Mesh of a Picture.
  template <class Drawn, class Upload>
  void beginFrame(std::span<const Drawn> drawn, const Upload& upload) {
    ++frame_;
    for (const Drawn& one : drawn) {
      Entry& entry = entries_[one.picture.get()];
      // Another picture may have come to lie where one was that is gone.
      if (entry.picture.lock() != one.picture) {
        bytes_ -= entry.mesh.bytes;
        entry.picture = one.picture;
        entry.mesh = upload(*one.picture);
        bytes_ += entry.mesh.bytes;
      }
      entry.last_use = frame_;
    }
    dropUnused();
  }
  /// One of the frame.
  const Mesh& mesh(const Picture& picture) const { return entries_.find(&picture)->second.mesh; }
  Mesh& mesh(const Picture& picture) { return entries_.find(&picture)->second.mesh; }
  std::uint64_t bytes() const { return bytes_; }

 private:
  struct Entry {
    std::weak_ptr<const Picture> picture;
    Mesh mesh;
    std::uint64_t last_use = 0;  ///< frame
  };
  using Entries = std::unordered_map<const Picture*, Entry>;

  typename Entries::iterator drop(typename Entries::iterator entry) {
    bytes_ -= entry->second.mesh.bytes;
    return entries_.erase(entry);
  }

  void dropUnused() {
    std::vector<std::pair<std::uint64_t, const Picture*>> unused;
    for (auto it = entries_.begin(); it != entries_.end();) {
      if (it->second.picture.expired()) {
        it = drop(it);
        continue;
      }
      if (it->second.last_use != frame_) unused.emplace_back(it->second.last_use, it->first);
      ++it;
    }
    if (bytes_ <= limit_) return;
    std::sort(unused.begin(), unused.end());
    for (const auto& [use, picture] : unused) {
      if (bytes_ <= limit_) return;
      drop(entries_.find(picture));
    }
  }

  const std::uint64_t limit_;
  Entries entries_;
  std::uint64_t bytes_ = 0;
  std::uint64_t frame_ = 0;
};

}  // namespace lod::draw
