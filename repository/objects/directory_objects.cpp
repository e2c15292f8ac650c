#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <utility>

#include "base/file.h"
#include "repository/objects/objects.h"

namespace repository {
namespace {

namespace fs = std::filesystem;
using base::Error;
using base::ErrorCode;
using base::Result;

// Opens a file or directory for reading; on failure errno says why.
base::FileDescriptor openToRead(const std::string& path) {
  return base::FileDescriptor(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
}

class DirectorySource final : public ObjectSource {
 public:
  explicit DirectorySource(std::string place) : place_(std::move(place)) {}

  Result<base::Bytes> read(const std::string& name, std::uint64_t offset, std::uint64_t length) const override {
    const std::string path = place_ + "/" + name;
    LUMIGRID_TRY(checkObjectName(place_, name));
    const base::FileDescriptor file = openToRead(path);
    if (!file) return base::systemError(path, "open", errno);
    // A damaged index may ask for any length, so memory is allocated only after the file is known to be that long.
    struct stat info {};
    if (::fstat(file.get(), &info) != 0) return base::systemError(path, "read", errno);
    if (!S_ISREG(info.st_mode)) return base::systemError(path, "read", EISDIR);
    const auto size = static_cast<std::uint64_t>(info.st_size);
    if (offset > size || length > size - offset) return tooShortError(path, size, offset, length);
    base::Bytes bytes(length);
    for (std::uint64_t done = 0; done < length;) {
      const ssize_t n = ::pread(file.get(), bytes.data() + done, length - done, static_cast<off_t>(offset + done));
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) return base::systemError(path, "read", n == 0 ? EIO : errno);
      done += static_cast<std::uint64_t>(n);
    }
    return bytes;
  }

  Result<std::uint64_t> size(const std::string& name) const override {
    const std::string path = place_ + "/" + name;
    LUMIGRID_TRY(checkObjectName(place_, name));
    struct stat info {};
    if (::stat(path.c_str(), &info) != 0) return base::systemError(path, "read", errno);
    if (!S_ISREG(info.st_mode)) return base::systemError(path, "read", EISDIR);
    return static_cast<std::uint64_t>(info.st_size);
  }

  const std::string& place() const override { return place_; }

 private:
  std::string place_;
};

class DirectorySink final : public ObjectSink {
 public:
  DirectorySink(std::string place, base::FileDescriptor lock) : place_(std::move(place)), lock_(std::move(lock)) {}

  Result<void> put(const std::string& name, base::ByteView bytes, const std::string&) override {
    LUMIGRID_TRY(prepare(name));
    return base::writeFileAtomically(place_ + "/" + name, bytes);
  }

  Result<void> putFile(const std::string& name, const std::string& path, const std::string&) override {
    LUMIGRID_TRY(prepare(name));
    LUMIGRID_ASSIGN_OR_RETURN(auto source, base::MappedFile::open(path));
    LUMIGRID_ASSIGN_OR_RETURN(auto file, base::AtomicFile::create(place_ + "/" + name));
    LUMIGRID_TRY(file.write(source.bytes()));
    return file.commit();
  }

  Result<std::optional<std::uint64_t>> size(const std::string& name) override {
    LUMIGRID_TRY(checkObjectName(place_, name));
    struct stat info {};
    const std::string path = place_ + "/" + name;
    if (::stat(path.c_str(), &info) == 0) return std::optional(static_cast<std::uint64_t>(info.st_size));
    if (errno == ENOENT) return std::optional<std::uint64_t>();
    return base::systemError(path, "read", errno);
  }

  Result<std::vector<std::string>> list(const std::string& prefix) override {
    if (!prefix.empty()) LUMIGRID_TRY(checkObjectName(place_, prefix));
    std::vector<std::string> names;
    std::error_code error;
    const fs::path root(place_);
    const bool exists = fs::exists(root / prefix, error);
    if (error) return base::systemError(place_, "list", error.value());
    if (!exists) return names;
    // Other programs may keep files here: folders that we may not read (lost+found), dangling links.
    constexpr auto kSkip = fs::directory_options::skip_permission_denied;
    for (fs::recursive_directory_iterator it(root / prefix, kSkip, error), end; !error && it != end;
         it.increment(error)) {
      std::error_code gone;
      if (it->is_regular_file(gone)) names.push_back(it->path().lexically_relative(root).generic_string());
    }
    if (error) return base::systemError(place_, "list", error.value());
    std::sort(names.begin(), names.end());
    return names;
  }

  Result<void> remove(const std::string& name) override {
    LUMIGRID_TRY(checkObjectName(place_, name));
    std::error_code error;
    fs::remove(fs::path(place_) / name, error);
    if (error) return base::systemError(place_ + "/" + name, "remove", error.value());
    return {};
  }

  const std::string& place() const override { return place_; }

 private:
  Result<void> prepare(const std::string& name) {
    LUMIGRID_TRY(checkObjectName(place_, name));
    std::error_code error;
    const fs::path path = fs::path(place_) / name;
    fs::create_directories(path.parent_path(), error);
    if (error) return base::systemError(path.parent_path().string(), "make this directory", error.value());
    base::removeUnfinished(path.string());  // a killed publisher may have left it
    return {};
  }

  std::string place_;
  base::FileDescriptor lock_;
};

}  // namespace

bool isObjectName(const std::string& name) {
  if (name.empty() || name.size() > 1000) return false;
  for (std::size_t begin = 0; begin <= name.size();) {
    const std::size_t end = std::min(name.find('/', begin), name.size());
    const std::string part = name.substr(begin, end - begin);
    if (part.empty() || part == "." || part == "..") return false;
    begin = end + 1;
  }
  return std::none_of(name.begin(), name.end(),
                      [](char c) { return c == '\\' || static_cast<unsigned char>(c) < 0x20 || c == 0x7f; });
}

Result<void> checkObjectName(const std::string& place, const std::string& name) {
  if (isObjectName(name)) return {};
  return Error{ErrorCode::kInvalidInput, place + ": no object can be named '" + name + "'"};
}

Error tooShortError(const std::string& object, std::optional<std::uint64_t> size, std::uint64_t offset,
                    std::uint64_t length) {
  const std::string has = size ? "has " + std::to_string(*size) + " bytes" : "is too short";
  return {ErrorCode::kInvalidInput, object + ": " + has + ", " + std::to_string(length) + " are wanted from byte " +
                                        std::to_string(offset) + " on; it is truncated, publish it again"};
}

Result<std::unique_ptr<ObjectSource>> openDirectorySource(const std::string& place) {
  std::error_code error;
  if (!fs::is_directory(place, error)) return Error{ErrorCode::kNotFound, place + ": is no directory"};
  return std::unique_ptr<ObjectSource>(new DirectorySource(place));
}

Result<std::unique_ptr<ObjectSink>> openDirectorySink(const std::string& place) {
  std::error_code error;
  fs::create_directories(place, error);
  if (error) return base::systemError(place, "make this directory", error.value());
  // Two publishers would take each other's temporary files for those of a killed one, so the directory is locked. A
  // lock on the directory itself leaves no file behind. File systems without locks (some network ones) go unlocked.
  base::FileDescriptor lock = openToRead(place);
  if (!lock) return base::systemError(place, "open", errno);
  if (::flock(lock.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
    return Error{ErrorCode::kBusy, place + ": another program is publishing there; wait for it or stop it"};
  return std::unique_ptr<ObjectSink>(new DirectorySink(place, std::move(lock)));
}

}  // namespace repository
