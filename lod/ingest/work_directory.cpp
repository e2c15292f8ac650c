#include "lod/ingest/work_directory.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <utility>

#include "base/crc32c.h"
#include "base/file.h"
#include "base/file_lock.h"
#include "base/text.h"

namespace lod::ingest {
namespace {

namespace fs = std::filesystem;
using base::Error;
using base::ErrorCode;

constexpr const char* kDamaged = ": the work files are damaged; remove this directory and build again";
constexpr const char* kFiles[] = {"vertices", "triangles", "corners", "textures", "buckets", "patches", "pages",
                                  "points",   "leaves",    "nodes",   "runs",     "plain",   "ordered", "classes",
                                  "units",    "stage1",    "stage2",  "stage3",   "stage4",  "stage5",  "key"};

std::string stageFile(const std::string& path, Stage stage) {
  return path + "/stage" + std::to_string(static_cast<unsigned>(stage));
}

// Removes the files that a builder wrote into `path`, complete or not; other files stay.
void removeFiles(const std::string& path) {
  std::error_code ignored;
  std::vector<fs::path> found;
  for (const auto& entry : fs::directory_iterator(path, ignored)) {
    const std::string file = entry.path().filename().string();
    const auto isOurs = [&](const char* name) { return file == name || base::isUnfinished(file, name); };
    if (std::any_of(std::begin(kFiles), std::end(kFiles), isOurs)) found.push_back(entry.path());
  }
  for (const fs::path& file : found) fs::remove(file, ignored);
}

base::Result<void> needFree(const std::string& directory, std::uint64_t bytes, const std::string& purpose,
                            const std::string& advice) {
  std::error_code error;
  const fs::space_info space = fs::space(directory, error);
  if (error || space.available >= bytes) return {};
  return Error{ErrorCode::kNoSpace, directory + ": no space left on device for " + purpose + ": about " +
                                        base::formatBytes(bytes) + " are needed, " +
                                        base::formatBytes(space.available) + " are free; " + advice};
}

base::Result<void> writeKey(const std::string& directory, const ResumeKey& key) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto text, key());
  return base::writeFileAtomically(directory + "/key", base::viewOfText(text));
}

}  // namespace

// The threads that store stages wait for it: for kStageDelay, or until storing is wanted at once or abandoned.
struct WorkDirectory::Delay {
  std::mutex mutex;
  std::condition_variable changed;
  bool at_once = false;
  std::atomic<bool> abandoned = false;

  void set(bool now) {
    const std::lock_guard lock(mutex);
    at_once = now;
    changed.notify_all();
  }
  void wait() {
    std::unique_lock lock(mutex);
    changed.wait_for(lock, kStageDelay, [this] { return at_once || abandoned; });
  }
};

WorkDirectory::WorkDirectory() : delay_(std::make_shared<Delay>()) {}

void WorkDirectory::abandonStages() {
  delay_->abandoned = true;
  delay_->set(true);
}

base::Result<WorkDirectory> WorkDirectory::open(const std::string& path, ResumeKey key) {
  std::error_code error;
  fs::create_directories(path, error);
  if (error) return base::systemError(path, "make this directory", error.value());
  WorkDirectory out;
  out.path_ = path;
  out.key_ = std::move(key);
  auto lock = base::tryLockFile(path + "/lock");
  if (!lock && lock.error().code == ErrorCode::kBusy)
    return Error{ErrorCode::kBusy, path + ": another build is at work here; wait for it, or choose another directory"};
  if (!lock) return lock.error();
  out.lock_ = std::move(*lock);

  // Stages count only beside the key under which they were made.
  if (const auto stored = base::readFile(path + "/key"); out.key_ && stored) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto asked, out.key_());
    if (std::string(stored->begin(), stored->end()) == asked) out.finished_ = out.lastStored();
    if (out.finished_ != Stage::kNone) return out;
  }
  removeFiles(path);
  return out;
}

Stage WorkDirectory::lastStored() const {
  auto last = Stage::kNone;
  const auto next = [&] { return static_cast<Stage>(static_cast<std::uint8_t>(last) + 1); };
  while (readStageState(next())) last = next();
  return last;
}

WorkDirectory::~WorkDirectory() {
  (void)settle();
}

base::Result<void> WorkDirectory::finishStage(Stage stage, base::Bytes state, std::vector<std::string> files,
                                              std::function<void()> on_stored) {
  if (storing_.valid() && storing_.wait_for(std::chrono::seconds(0)) == std::future_status::ready)
    LUMIGRID_TRY(storing_.get());
  finished_ = stage;
  // Without a key no later run goes on from here.
  if (!key_) {
    if (on_stored) on_stored();
    return {};
  }
  auto store = [path = path_, key = key_, delay = delay_, stage, state = std::move(state), files = std::move(files),
                on_stored = std::move(on_stored), before = std::move(storing_)]() mutable -> base::Result<void> {
    delay->wait();
    if (before.valid()) LUMIGRID_TRY(before.get());
    for (const std::string& file : files) {
      if (delay->abandoned) return {};
      LUMIGRID_TRY(base::syncFile(path + "/" + file));
    }
    if (delay->abandoned) return {};
    if (stage == Stage::kSpooled) LUMIGRID_TRY(writeKey(path, key));
    base::ByteWriter out;
    out.u32(base::crc32c(state));
    out.bytes(state);
    LUMIGRID_TRY(base::writeFileAtomically(stageFile(path, stage), out.view()));
    if (on_stored) on_stored();
    return {};
  };
  storing_ = std::async(std::launch::async, std::move(store));
  return {};
}

base::Result<void> WorkDirectory::settle() {
  if (!storing_.valid()) return {};
  delay_->set(true);
  auto stored = storing_.get();
  delay_->set(false);
  return stored;
}

base::Result<base::Bytes> WorkDirectory::readStageState(Stage stage) const {
  LUMIGRID_ASSIGN_OR_RETURN(auto bytes, base::readFile(stageFile(path_, stage)));
  base::ByteReader in(bytes);
  const std::uint32_t crc = in.u32();
  const base::ByteView rest = in.bytes(in.remaining());
  if (!in.ok() || base::crc32c(rest) != crc) return damaged();
  return base::Bytes(rest.begin(), rest.end());
}

base::Error WorkDirectory::damaged() const {
  return damagedWorkFiles(path_);
}

base::Error damagedWorkFiles(const std::string& directory) {
  return {ErrorCode::kInvalidInput, directory + kDamaged};
}

bool isDamageError(const base::Error& error) {
  return error.message.find(kDamaged) != std::string::npos;
}

bool WorkDirectory::has(const std::string& name) const {
  return fs::exists(fs::path(path_) / name);
}

void WorkDirectory::remove() {
  removeFiles(path_);
  std::error_code ignored;
  fs::remove(fs::path(path_) / "lock", ignored);
  fs::remove(path_, ignored);
}

base::Result<void> WorkDirectory::needSpace(std::uint64_t bytes, const std::string& purpose) const {
  return needFree(path_, bytes, purpose, "free some, or name a roomier place with --tmpdir, and build again");
}

base::Result<void> needOutputSpace(const std::string& path, std::uint64_t bytes) {
  const fs::path directory = fs::path(path).parent_path();
  return needFree(directory.empty() ? "." : directory.string(), bytes, "the hierarchy",
                  "free some, or choose another output, and build again");
}

}  // namespace lod::ingest
