#include "repository/objects/mirror.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <utility>

#include "base/file.h"
#include "base/file_lock.h"
#include "base/hash/sha256.h"

namespace repository {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;

// The unfinished download, locked by the one process that writes it.
class PartialFile {
 public:
  explicit PartialFile(std::string path) : path_(std::move(path)) {}

  // Waits for the process that holds the lock. If that one finishes, it renames its file and we get a new, empty one.
  Result<void> lock() {
    LUMIGRID_ASSIGN_OR_RETURN(file_, base::lockFile(path_));
    return {};
  }

  int fd() const { return file_.get(); }
  std::uint64_t size() const {
    struct stat info {};
    return ::fstat(file_.get(), &info) == 0 ? static_cast<std::uint64_t>(info.st_size) : 0;
  }
  Result<void> truncate() {
    if (::ftruncate(file_.get(), 0) != 0) return base::systemError(path_, "write", errno);
    return {};
  }
  Result<void> append(base::ByteView bytes) { return base::writeAllAt(file_, path_, size(), bytes); }
  Result<void> finishAs(const std::string& path) {
    if (::fsync(file_.get()) != 0) return base::systemError(path, "write", errno);
    if (::rename(path_.c_str(), path.c_str()) != 0) return base::systemError(path, "rename into place", errno);
    base::syncDirectoryOf(path);
    return {};
  }
  void remove() { ::unlink(path_.c_str()); }

 private:
  std::string path_;
  base::FileDescriptor file_;
};

Result<void> hashFile(int fd, const std::string& path, base::Sha256& hash) {
  base::Bytes buffer(std::size_t{1} << 20);
  for (off_t offset = 0;;) {
    const ssize_t n = ::pread(fd, buffer.data(), buffer.size(), offset);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return base::systemError(path, "read", errno);
    if (n == 0) return {};
    hash.add(base::ByteView(buffer).first(static_cast<std::size_t>(n)));
    offset += n;
  }
}

// Whether the file exists and has this SHA-256.
Result<bool> hasDigest(const std::string& path, const std::string& sha256) {
  const base::FileDescriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!file && errno == ENOENT) return false;
  if (!file) return base::systemError(path, "open", errno);
  base::Sha256 hash;
  LUMIGRID_TRY(hashFile(file.get(), path, hash));
  return base::hexOf(hash.finish()) == sha256;
}

Result<void> checkFreeSpace(const std::string& path, std::uint64_t bytes) {
  std::error_code failed;
  const auto space = std::filesystem::space(std::filesystem::path(path).parent_path(), failed);
  if (failed || space.available >= bytes) return {};
  return Error{ErrorCode::kNoSpace, path + ": " + std::to_string(bytes) + " bytes are to come and " +
                                        std::to_string(space.available) +
                                        " are free; free some space and run the same command again"};
}

// Appends the missing bytes and returns the SHA-256 of the whole file.
Result<std::string> download(const ObjectSource& source, const std::string& name, std::uint64_t total,
                             const std::string& path, PartialFile& file, const MirrorOptions& options) {
  base::Sha256 hash;
  LUMIGRID_TRY(hashFile(file.fd(), path, hash));
  for (std::uint64_t done = file.size(); done < total;) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, source.read(name, done, std::min(options.range_bytes, total - done)));
    LUMIGRID_TRY(file.append(bytes));
    hash.add(bytes);
    done += bytes.size();
    if (options.progress && !options.progress(done, total))
      return Error{ErrorCode::kCancelled, path + ": stopped; the next time goes on from here"};
  }
  return base::hexOf(hash.finish());
}

}  // namespace

Result<std::string> mirrorObject(const ObjectSource& source, const std::string& name, const std::string& directory,
                                 const std::string& sha256, const MirrorOptions& options) {
  const std::string object = source.place() + "/" + name;
  LUMIGRID_TRY(checkObjectName(source.place(), name));
  if (sha256.size() != 64 || sha256.find_first_not_of("0123456789abcdef") != std::string::npos)
    return Error{ErrorCode::kInvalidInput, object + ": '" + sha256.substr(0, 100) + "' is no SHA-256 to check it by"};
  const std::string path = directory + "/" + name;
  std::error_code failed;
  std::filesystem::create_directories(std::filesystem::path(path).parent_path(), failed);
  if (failed) return base::systemError(directory, "make this directory", failed.value());

  LUMIGRID_ASSIGN_OR_RETURN(const auto is_there, hasDigest(path, sha256));
  if (is_there) return path;
  // The name of the part holds the SHA-256 of the whole, so another version of the object starts from zero.
  PartialFile file(path + ".partial-" + sha256.substr(0, 16));
  LUMIGRID_TRY(file.lock());
  if (file.size() == 0) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto is_there_now, hasDigest(path, sha256));
    if (is_there_now) return file.remove(), path;
  }

  LUMIGRID_ASSIGN_OR_RETURN(const auto total, source.size(name));
  if (file.size() > total) LUMIGRID_TRY(file.truncate());
  LUMIGRID_TRY(checkFreeSpace(path, total - file.size()));
  const bool resumed = file.size() > 0;
  auto digest = download(source, name, total, path, file, options);
  if (digest && *digest != sha256 && resumed) {
    // A power cut may have damaged the part that was kept, so the download starts from zero once.
    LUMIGRID_TRY(file.truncate());
    digest = download(source, name, total, path, file, options);
  }
  if (!digest) return digest.error();
  if (*digest != sha256) {
    file.remove();
    return Error{ErrorCode::kInvalidInput, object + ": its SHA-256 is " + *digest + ", not " + sha256 +
                                               "; it is damaged or of another scene, publish it again"};
  }
  LUMIGRID_TRY(file.finishAs(path));
  return path;
}

}  // namespace repository
