#include "lod/build/work_directory.h"

#include <malloc.h>
#include <sys/resource.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <utility>

#include "base/crc32c.h"
#include "base/file.h"
#include "base/file_lock.h"

namespace lod::build {
namespace {

namespace fs = std::filesystem;
using base::Error;
using base::ErrorCode;

constexpr const char* kDamaged = ": the work files are damaged; remove this directory and build again";
constexpr const char* kFiles[] = {"vertices", "triangles", "corners", "buckets", "patches", "points", "leaves", "nodes",
                                  "runs",     "plain",     "stage1",  "stage2",  "stage3",  "stage4", "key"};

std::string stageFile(const std::string& path, std::uint32_t stage) {
  return path + "/stage" + std::to_string(stage);
}

// What a builder wrote into `path`, whole or not; others' files stay.
void removeFiles(const std::string& path) {
  std::error_code ignored;
  for (const char* name : kFiles) {
    const fs::path file = fs::path(path) / name;
    fs::remove(file, ignored);
    base::removeUnfinished(file.string());
  }
}

base::Result<void> needFree(const std::string& directory, std::uint64_t bytes, const std::string& what,
                            const std::string& advice) {
  std::error_code error;
  const fs::space_info space = fs::space(directory, error);
  if (error || space.available >= bytes) return {};
  return Error{ErrorCode::kNoSpace, directory + ": no space left on device for " + what + ": about " + sizeText(bytes) +
                                        " are needed, " + sizeText(space.available) + " are free; " + advice};
}

// Whether a rerun can: what is wrong with the source stays wrong.
bool mayGoOn(const base::Error& error) {
  return error.code == ErrorCode::kCancelled || error.code == ErrorCode::kNoSpace || error.code == ErrorCode::kIo;
}

}  // namespace

base::Result<WorkDirectory> WorkDirectory::open(const std::string& path, const std::string& key) {
  std::error_code error;
  fs::create_directories(path, error);
  if (error) return base::systemError(path, "make this directory", error.value());
  WorkDirectory out;
  out.path_ = path;
  out.key_ = key;
  auto lock = base::tryLockFile(path + "/lock");
  if (!lock && lock.error().code == ErrorCode::kBusy)
    return Error{ErrorCode::kBusy, path + ": another build is at work here; wait for it, or choose another directory"};
  if (!lock) return lock.error();
  out.lock_ = std::move(*lock);

  const auto stored = base::readFile(path + "/key");
  if (!key.empty() && stored && std::string(stored->begin(), stored->end()) == key) {
    while (out.state(out.stage_ + 1)) ++out.stage_;
    if (out.stage_ > 0) return out;
  }
  removeFiles(path);
  LUMIGRID_TRY(base::writeFileAtomically(
      path + "/key", base::ByteView(reinterpret_cast<const std::uint8_t*>(key.data()), key.size())));
  return out;
}

WorkDirectory::WorkDirectory(WorkDirectory&& other) noexcept {
  *this = std::move(other);
}

WorkDirectory& WorkDirectory::operator=(WorkDirectory&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(key_, other.key_);
  std::swap(stage_, other.stage_);
  std::swap(lock_, other.lock_);
  std::swap(finishing_, other.finishing_);
  return *this;
}

WorkDirectory::~WorkDirectory() {
  (void)settle();
}

base::Result<void> WorkDirectory::finishStage(std::uint32_t stage, base::Bytes state, std::vector<std::string> files,
                                              std::function<void()> then) {
  LUMIGRID_TRY(settle());
  stage_ = stage;
  // Nobody goes on from what has no key.
  if (key_.empty()) {
    if (then) then();
    return {};
  }
  const auto finish = [path = path_, stage, state = std::move(state), files = std::move(files),
                       then = std::move(then)]() -> base::Result<void> {
    for (const std::string& file : files) LUMIGRID_TRY(base::syncFile(path + "/" + file));
    base::ByteWriter out;
    out.u32(base::crc32c(state));
    out.bytes(state);
    LUMIGRID_TRY(base::writeFileAtomically(stageFile(path, stage), out.view()));
    if (then) then();
    return {};
  };
  finishing_ = std::async(std::launch::async, finish);
  return {};
}

base::Result<void> WorkDirectory::settle() {
  return finishing_.valid() ? finishing_.get() : base::Result<void>();
}

base::Result<base::Bytes> WorkDirectory::state(std::uint32_t stage) const {
  auto bytes = base::readFile(stageFile(path_, stage));
  if (!bytes) return bytes.error();
  base::ByteReader in(*bytes);
  const std::uint32_t crc = in.u32();
  const base::ByteView rest = in.bytes(in.remaining());
  if (!in.ok() || base::crc32c(rest) != crc) return broken();
  return base::Bytes(rest.begin(), rest.end());
}

base::Error WorkDirectory::broken() const {
  return damagedWorkFiles(path_);
}

base::Result<void> buildIn(std::optional<WorkDirectory>& directory, const std::string& path, const std::string& key,
                           const std::string& output_path, const std::function<base::Result<void>()>& stages) {
  auto opened = WorkDirectory::open(path.empty() ? output_path + ".work" : path, key);
  if (!opened) return opened.error();
  directory = std::move(*opened);
  base::removeUnfinished(output_path);  // nobody else is writing it now
  auto done = stages();
  if (const auto settled = directory->settle(); done && !settled) done = settled;
  if (done || key.empty() || !mayGoOn(done.error())) directory->remove();
  return done;
}

base::Error damagedWorkFiles(const std::string& directory) {
  return {ErrorCode::kInvalidInput, directory + kDamaged};
}

bool isDamage(const base::Error& error) {
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

base::Result<void> WorkDirectory::needSpace(std::uint64_t bytes, const std::string& what) const {
  return needFree(path_, bytes, what, "free some, or name a roomier place with --tmpdir, and build again");
}

base::Result<TemporaryDirectory> TemporaryDirectory::make() {
  std::error_code error;
  std::string pattern = (fs::temp_directory_path(error) / "lumigrid-XXXXXX").string();
  if (::mkdtemp(pattern.data()) == nullptr) return base::systemError(pattern, "create", errno);
  return TemporaryDirectory(pattern);
}

TemporaryDirectory::~TemporaryDirectory() {
  std::error_code ignored;
  if (!path_.empty()) fs::remove_all(path_, ignored);
}

base::Result<void> needOutputSpace(const std::string& path, std::uint64_t bytes) {
  const fs::path directory = fs::path(path).parent_path();
  return needFree(directory.empty() ? "." : directory.string(), bytes, "the hierarchy",
                  "free some, or choose another output, and build again");
}

base::Result<void> needDescriptors(std::uint64_t count) {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur >= count) return {};
  return Error{ErrorCode::kNoSpace, "this process may have " + std::to_string(limit.rlim_cur) +
                                        " files open, building needs " + std::to_string(count) +
                                        "; raise the limit (ulimit -n) and build again"};
}

base::Result<void> needMemory(std::uint64_t bytes) {
  if (bytes >= kLeastMemory) return {};
  return Error{ErrorCode::kNoSpace, "the memory given, " + sizeText(bytes) + ", is too small: building needs " +
                                        sizeText(kLeastMemory) + " at least (--memory)"};
}

std::uint64_t machineMemory() {
  std::uint64_t bytes =
      static_cast<std::uint64_t>(::sysconf(_SC_PHYS_PAGES)) * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  std::ifstream limit("/sys/fs/cgroup/memory.max");
  if (std::uint64_t most = 0; limit >> most) bytes = std::min(bytes, most);
  return bytes;
}

void keepFreedMemory() {
  constexpr int kMegabyte = 1 << 20;
  ::mallopt(M_MMAP_THRESHOLD, 32 * kMegabyte);
  ::mallopt(M_TRIM_THRESHOLD, 128 * kMegabyte);
}

void releaseFreedMemory() {
  // Less than that is sooner used again than returned and fetched.
  constexpr std::size_t kWorthIt = std::size_t{32} << 20;
  if (::mallinfo2().fordblks > kWorthIt) ::malloc_trim(0);
}

std::string sizeText(std::uint64_t bytes) {
  std::array<char, 32> text{};
  const auto value = static_cast<double>(bytes);
  if (value >= 1e9)
    std::snprintf(text.data(), text.size(), "%.1f GB", value / 1e9);
  else
    std::snprintf(text.data(), text.size(), "%.1f MB", value / 1e6);
  return text.data();
}

}  // namespace lod::build
