#pragma once
// Where a build keeps its work files, how far it came, and whether there is room.
#include <chrono>
#include <cstdint>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/file.h"

namespace lod::ingest {

/// What decides a build's output besides its options, such as the checksums of the sources. To work them out takes a
/// while: whoever calls it waits for that. Called from any thread, maybe more than once. An error ends the build.
using ResumeKey = std::function<base::Result<std::string>()>;
/// `key` with `before` in front of it; none where it is none.
ResumeKey keyAfter(std::string before, ResumeKey key);

/// One builder at a time. Stages are finished one after the other; each leaves a state of its own, which appears whole
/// or not at all.
class WorkDirectory {
 public:
  /// Makes the directory, or takes the one that an earlier run left under the same key; anything else in it that a
  /// builder wrote is removed first. The key is asked for where an earlier run left one, else when the first stage is
  /// finished. No key: nothing is taken. Errors: kBusy, kNoSpace, kIo, the key's.
  static base::Result<WorkDirectory> open(const std::string& path, ResumeKey key);
  WorkDirectory(WorkDirectory&& other) noexcept;
  WorkDirectory& operator=(WorkDirectory&& other) noexcept;
  ~WorkDirectory();  ///< lets go; the files stay

  const std::string& path() const { return path_; }
  std::uint32_t stage() const { return stage_; }
  /// The stage counts for a later run once the disk has `files` (names in here, written and flushed) and then `state`;
  /// after that `then` may give back what it alone needed. Returns before: threads see to it, stage by stage, while
  /// later ones are under way, and after kStageDelay: a build that is done by then never waits for the disk. Without a
  /// key nobody goes on, and all of it is `then`, at once. Errors: those of stages finished before, where they are
  /// known already.
  base::Result<void> finishStage(std::uint32_t stage, base::Bytes state, std::vector<std::string> files,
                                 std::function<void()> then = {});
  /// What a build that is killed may have to do once more, though it was done: less than syncing it would cost is not
  /// worth syncing.
  static constexpr std::chrono::milliseconds kStageDelay{200};
  /// Waits for those threads, which see to it at once. The first error: kNoSpace, kIo, the key's.
  base::Result<void> settle();
  base::Result<base::Bytes> state(std::uint32_t stage) const;
  bool has(const std::string& name) const;
  /// The stages are no longer worth going on from: of what is still to be done for them only what is under way is.
  void abandonStages();
  /// Removes the work files, and the directory where nothing else lies in it.
  void remove();
  /// kNoSpace when the disk has fewer bytes free than that; `what` they are for.
  base::Result<void> needSpace(std::uint64_t bytes, const std::string& what) const;
  base::Error broken() const;

 private:
  WorkDirectory();
  std::string path_;
  ResumeKey key_;
  std::uint32_t stage_ = 0;
  base::FileDescriptor lock_;
  struct Delay;
  std::shared_ptr<Delay> delay_;
  std::future<base::Result<void>> finishing_;
};

/// A whole build: takes the work directory `path` (empty: beside `output_path`) into `directory`, runs `stages` and
/// removes it again, unless they failed and a rerun under the same key can go on. Errors: those of opening it, and
/// theirs.
base::Result<void> buildIn(std::optional<WorkDirectory>& directory, const std::string& path, const ResumeKey& key,
                           const std::string& output_path, const std::function<base::Result<void>()>& stages);

/// Says that the work files in `directory` are not what their builder wrote.
base::Error damagedWorkFiles(const std::string& directory);
/// Whether an error is that: a build from the source mends it.
bool isDamage(const base::Error& error);

/// kNoSpace when the disk that `path` will lie on has fewer bytes free.
base::Result<void> needOutputSpace(const std::string& path, std::uint64_t bytes);
/// kNoSpace when this process may not have so many files open.
base::Result<void> needDescriptors(std::uint64_t count);
/// Least memory a build needs.
inline constexpr std::uint64_t kMinMemory = std::uint64_t{256} << 20;
/// kNoSpace when less than that is given.
base::Result<void> needMemory(std::uint64_t bytes);

}  // namespace lod::ingest
