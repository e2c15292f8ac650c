#pragma once
// Finds where a ray meets the full-resolution surface, for /pick (docs/formats/http.md). A thread of its own casts the
// rays: a block that nobody read yet may come from a disk, for which no viewer should wait.
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "lod/patch/ray_cast.h"
#include "server/net/http_text.h"

namespace server {

/// The ray in world coordinates. Errors are one line for the visitor, with the name that is wrong.
base::Result<lod::patch::Ray> parsePickRequest(const Query& query);

/// The answer as JSON; `ray` is in world coordinates, `origin` and `units` are the scene's. Errors: damaged blocks of
/// the file.
base::Result<std::string> pick(const glm::dvec3& origin, const std::string& units, const lod::patch::PatchFile& patches,
                               const lod::patch::Ray& ray);

/// Its end drops queued rays and waits for the one being cast.
class Picker {
 public:
  using OnPick = std::function<void(base::Result<std::string> json)>;
  static constexpr std::size_t kMaxQueued = 256;  ///< rays; whoever asks for more is told to come again
  /// The rays of one address among them: enough for a page that picks along a line, and others are still answered.
  static constexpr std::size_t kMaxOfOneAddress = kMaxQueued / 4;

  /// Both must outlive this.
  Picker(const base::Scene& scene, const lod::patch::PatchFile& patches);
  /// For the thread that may change the scene. Calls `done` on the picker's thread, unless the ray is cancelled by its
  /// `id` before. Returns false, and never calls it, when kMaxQueued rays wait already, or kMaxOfOneAddress of this
  /// `address`, a limitKey().
  bool submit(std::uint64_t id, const std::string& address, const lod::patch::Ray& ray, OnPick done);
  /// Drops the ray if it still waits. Any thread.
  void cancel(std::uint64_t id);

 private:
  struct Job {
    std::uint64_t id = 0;
    std::string address;
    lod::patch::Ray ray;
    std::string units;  // the scene's may change meanwhile
    OnPick done;
  };
  void runThread(const std::stop_token& stop);

  const base::Scene& scene_;
  const lod::patch::PatchFile& patches_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<Job> queue_;
  std::jthread thread_;  // last: it uses the others
};

}  // namespace server
