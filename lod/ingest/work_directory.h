#pragma once
// The directory in which a build keeps its work files and notes which stages it has finished, so that a build that was
// stopped or killed can go on; and the checks that there is room for a build.
#include <chrono>
#include <cstdint>
#include <functional>
#include <future>
#include <memory>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/file.h"

namespace lod::ingest {

/// The stages of a build in their order, by what is on disk once they are finished. The first two are the same for all
/// methods; later ones share numbers, since a directory is used by one method only.
enum class Stage : std::uint8_t {
  kNone = 0,
  kSpooled = 1,         ///< the source's vertices and triangles lie in the spool
  kSorted = 2,          ///< the triangles lie in buckets, points in tiles
  kSourceReleased = 3,  ///< lod/ingest/shared_source: the buckets are gone, since all methods have had them
  kPatchLeaves = 3,     ///< lod/patch/builder: the leaf patches
  kSplatLeaves = 3,     ///< lod/qsplat/builder: all that leaves need to know of other tiles
  kSplatSubtrees = 4,   ///< lod/qsplat/builder: the tree of each tile
  kHlodOrdered = 3,     ///< lod/hlod/builder: the triangles in order
  kHlodNodes = 4,       ///< lod/hlod/builder: all nodes
  kPmrOrdered = 3,      ///< lod/pmr/builder: the points in order, and the octree
  kPmrClasses = 4,      ///< lod/pmr/builder: normal and class of each point
  kPmrLeaves = 5,       ///< lod/pmr/builder: the chunks of each leaf
};

/// Gives a text that is the same as long as the output would be, apart from the build's options: the checksums of the
/// sources. It may take as long as reading them, so it is asked for only when needed. Called from any thread, maybe
/// more than once. An error ends the build.
using ResumeKey = std::function<base::Result<std::string>()>;

/// One builder uses it at a time. Stages are finished one after the other; each leaves a state, which appears whole or
/// not at all.
class WorkDirectory {
 public:
  /// Makes the directory, or takes over the one that an earlier run left under the same key; anything else in it that a
  /// builder wrote is removed first. The key is asked for where an earlier run left one, else when the first stage is
  /// finished. With an empty key nothing is taken over. Errors: kBusy, kNoSpace, kIo, the key's.
  static base::Result<WorkDirectory> open(const std::string& path, ResumeKey key);
  WorkDirectory(WorkDirectory&& other) noexcept = default;
  WorkDirectory& operator=(WorkDirectory&& other) noexcept = default;
  ~WorkDirectory();  ///< releases the directory; the files stay

  const std::string& path() const { return path_; }
  bool isFinished(Stage stage) const { return finished_ >= stage; }
  /// A later run can go on behind this stage once the disk holds `files` (names in this directory, already written and
  /// flushed) and then `state`; after that `on_stored` may release what only this stage needed. Returns at once:
  /// threads store one stage after the other while later ones are under way, and not before kStageDelay, so that a
  /// build that is done by then never waits for the disk. With an empty key nothing is stored, and `on_stored` is
  /// called at once. Errors: those met so far in storing earlier stages.
  base::Result<void> finishStage(Stage stage, base::Bytes state, std::vector<std::string> files,
                                 std::function<void()> on_stored = {});
  /// A build that is killed loses at most this much finished work beyond its last stored stage. Syncing costs about as
  /// much as that on a slow disk.
  static constexpr std::chrono::milliseconds kStageDelay{200};
  /// Stores the finished stages now, and waits for it. Returns the first error: kNoSpace, kIo, the key's.
  base::Result<void> settle();
  /// Returns the state that a finished stage left. Errors: kNotFound, kIo, damaged work files.
  base::Result<base::Bytes> readStageState(Stage stage) const;
  bool has(const std::string& name) const;
  /// Gives up storing stages, since the output is complete; what is being stored right now is still stored.
  void abandonStages();
  /// Removes the work files, and the directory where nothing else lies in it.
  void remove();
  /// kNoSpace when the disk has fewer bytes free; `purpose` names what they are for.
  base::Result<void> needSpace(std::uint64_t bytes, const std::string& purpose) const;
  /// The error that says that the work files are damaged.
  base::Error damaged() const;

 private:
  WorkDirectory();
  Stage lastStored() const;

  std::string path_;
  ResumeKey key_;
  Stage finished_ = Stage::kNone;
  base::FileDescriptor lock_;
  struct Delay;
  std::shared_ptr<Delay> delay_;
  std::future<base::Result<void>> storing_;
};

/// Says that the work files in `directory` are not what their builder wrote.
base::Error damagedWorkFiles(const std::string& directory);
/// Whether the error means damaged work files, which a build from the source replaces.
bool isDamageError(const base::Error& error);

/// kNoSpace when the disk that `path` will lie on has fewer bytes free.
base::Result<void> needOutputSpace(const std::string& path, std::uint64_t bytes);
/// The least memory that a build works with. Half of it is kept for code, stacks and small tables.
inline constexpr std::uint64_t kMinMemory = std::uint64_t{256} << 20;

}  // namespace lod::ingest
