#pragma once
// Where a build keeps its work files, how far it came, and whether there is room.
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

namespace lod::build {

/// One builder at a time. Stages are finished one after the other; each leaves a state of its own, which appears whole
/// or not at all.
class WorkDirectory {
 public:
  /// Makes the directory, or takes the one that an earlier run left under the same key; anything else in it that a
  /// builder wrote is removed first. Empty key: nothing is taken. Errors: kBusy, kNoSpace, kIo.
  static base::Result<WorkDirectory> open(const std::string& path, const std::string& key);
  WorkDirectory(WorkDirectory&& other) noexcept;
  WorkDirectory& operator=(WorkDirectory&& other) noexcept;
  ~WorkDirectory();  ///< lets go; the files stay

  const std::string& path() const { return path_; }
  std::uint32_t stage() const { return stage_; }
  /// The stage counts for a later run once the disk has `files` (names in here, written and flushed) and then `state`;
  /// after that `then` may give back what it alone needed. Returns before: a thread sees to it while the next stage is
  /// under way. Without a key nobody goes on, and all of it is `then`, at once. Errors: those of the stage finished
  /// before.
  base::Result<void> finishStage(std::uint32_t stage, base::Bytes state, std::vector<std::string> files,
                                 std::function<void()> then = {});
  /// Waits for that thread. Errors: kNoSpace, kIo.
  base::Result<void> settle();
  base::Result<base::Bytes> state(std::uint32_t stage) const;
  bool has(const std::string& name) const;
  /// Removes the work files, and the directory where nothing else lies in it.
  void remove();
  /// kNoSpace when the disk has fewer bytes free than that; `what` they are for.
  base::Result<void> needSpace(std::uint64_t bytes, const std::string& what) const;
  base::Error broken() const;

 private:
  WorkDirectory() = default;
  std::string path_;
  std::string key_;
  std::uint32_t stage_ = 0;
  base::FileDescriptor lock_;
  std::future<base::Result<void>> finishing_;
};

/// A whole build: takes the work directory `path` (empty: beside `output_path`) into `directory`, runs `stages` and
/// removes it again, unless they failed and a rerun under the same key can go on. Errors: those of opening it, and
/// theirs.
base::Result<void> buildIn(std::optional<WorkDirectory>& directory, const std::string& path, const std::string& key,
                           const std::string& output_path, const std::function<base::Result<void>()>& stages);

/// Says that the work files in `directory` are not what their builder wrote.
base::Error damagedWorkFiles(const std::string& directory);
/// Whether an error is that: a build from the source mends it.
bool isDamage(const base::Error& error);

/// A new directory under the system's place for temporary files; removed with all that is in it.
class TemporaryDirectory {
 public:
  static base::Result<TemporaryDirectory> make();
  TemporaryDirectory(TemporaryDirectory&& other) noexcept : path_(std::move(other.path_)) { other.path_.clear(); }
  TemporaryDirectory& operator=(TemporaryDirectory&&) = delete;
  ~TemporaryDirectory();
  const std::string& path() const { return path_; }

 private:
  explicit TemporaryDirectory(std::string path) : path_(std::move(path)) {}
  std::string path_;
};

/// kNoSpace when the disk that `path` will lie on has fewer bytes free.
base::Result<void> needOutputSpace(const std::string& path, std::uint64_t bytes);
/// kNoSpace when this process may not have so many files open.
base::Result<void> needDescriptors(std::uint64_t count);
/// Least memory a build needs.
inline constexpr std::uint64_t kLeastMemory = std::uint64_t{256} << 20;
/// kNoSpace when less than that is given.
base::Result<void> needMemory(std::uint64_t bytes);
/// Physical memory, or the limit set for this process' group where that is less.
std::uint64_t machineMemory();
/// Lets the allocator keep what one piece of work frees for the next one, which is of its size: fetching it from the
/// system anew costs a fault for each page. For the whole process.
void keepFreedMemory();
/// Returns to the system what the allocator keeps for later.
void releaseFreedMemory();
/// "1.5 GB".
std::string sizeText(std::uint64_t bytes);

}  // namespace lod::build
