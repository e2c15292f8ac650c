#pragma once
// Where a ray meets the full-resolution surface, asked over HTTP (docs/formats/http.md, /pick), and the thread that
// looks for it: a block that nobody read yet may come from a disk, for which no viewer should wait.
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

/// World coordinates. Errors are one line for the visitor, with the name that is wrong.
base::Result<lod::patch::Ray> parsePickRequest(const Query& query);

/// The answer as JSON; `ray` in world coordinates. An error is the file's: its blocks are damaged.
base::Result<std::string> pick(const base::Scene& scene, const lod::patch::PatchFile& patches,
                               const lod::patch::Ray& ray);

class Picker {
 public:
  using Done = std::function<void(base::Result<std::string> json)>;
  static constexpr std::size_t kLongestQueue = 256;

  /// Both must outlive this.
  Picker(const base::Scene& scene, const lod::patch::PatchFile& patches);
  /// Drops what is queued, waits for the one in hand.
  ~Picker();
  Picker(const Picker&) = delete;
  Picker& operator=(const Picker&) = delete;
  /// `done` is called on the picker's thread. False, and `done` is never called: kLongestQueue rays wait already.
  bool submit(const lod::patch::Ray& ray, Done done);

 private:
  struct Job {
    lod::patch::Ray ray;
    Done done;
  };
  void work();

  const base::Scene& scene_;
  const lod::patch::PatchFile& patches_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Job> queue_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace server
