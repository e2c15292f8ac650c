// A library for LD_PRELOAD that makes one call of a process fail: the n-th of those to files, sockets and memory maps,
// counted over all threads. Standard input, output and error are left alone. It reads
//
//   LUMIGRID_FAULT_AT       the number of the call, from 0; missing: none fails
//   LUMIGRID_FAULT_VARIANT  0 or 1: which of the two errors that each kind of call has
//   LUMIGRID_FAULT_REPORT   a file that gets "failed NAME" when the call fails, and "calls N" when the process ends
//   LUMIGRID_FAULT_FOLDER   calls to files below this folder wait while a file FOLDER.hangs exists, as those to a
//   network
//                           file system whose server is gone. Files that are mapped do not
//
// Calls within the C library (of streams, of malloc) do not come by here. Those of checked builds do (_FORTIFY_SOURCE).
#undef _FORTIFY_SOURCE  // its own calls are the plain ones
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace {

struct Errors {
  int first, second;
};
// The errors that man pages name for them and that happen: broken disks, full ones, limits, peers that are gone.
constexpr Errors kReads{EIO, EINTR}, kWrites{ENOSPC, EIO}, kOpens{EMFILE, EACCES}, kMaps{ENOMEM, EAGAIN};
constexpr Errors kAccepts{EMFILE, ECONNABORTED}, kReceives{ECONNRESET, EINTR}, kSends{EPIPE, EINTR};
constexpr Errors kMakes{EMFILE, ENOBUFS}, kSyncs{EIO, ENOSPC}, kWaits{EINTR, EINTR};

std::atomic<long> calls{0};

long numberOf(const char* name, long otherwise) {
  const char* text = std::getenv(name);
  return text == nullptr ? otherwise : std::atol(text);
}

/// Past the wrappers below.
void report(const char* word, const char* name, long number) {
  const char* path = std::getenv("LUMIGRID_FAULT_REPORT");
  if (path == nullptr) return;
  char line[128];
  const int length = name != nullptr ? std::snprintf(line, sizeof(line), "%s %s\n", word, name)
                                     : std::snprintf(line, sizeof(line), "%s %ld\n", word, number);
  const long file = ::syscall(SYS_openat, AT_FDCWD, path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (file < 0) return;
  ::syscall(SYS_write, file, line, length);
  ::syscall(SYS_close, file);
}

/// Counts the call, and whether it is the one that fails: errno is set then.
bool fails(const char* name, const Errors& errors) {
  static const long at = numberOf("LUMIGRID_FAULT_AT", -1);
  static const bool second = numberOf("LUMIGRID_FAULT_VARIANT", 0) == 1;
  if (calls++ != at) return false;
  report("failed", name, 0);
  errno = second ? errors.second : errors.first;
  return true;
}
/// The folder that may hang, with its slash; empty: none.
const char* folderThatHangs() {
  static char folder[4096];
  static const int length = [] {
    const char* name = std::getenv("LUMIGRID_FAULT_FOLDER");
    return name == nullptr ? 0 : std::snprintf(folder, sizeof(folder), "%s/", name);
  }();
  return length > 0 ? folder : "";
}
bool hangs() {
  static char marker[4096];
  static const int length = std::snprintf(marker, sizeof(marker), "%.*s.hangs",
                                          static_cast<int>(std::strlen(folderThatHangs())) - 1, folderThatHangs());
  return length > 0 && ::syscall(SYS_faccessat, AT_FDCWD, marker, F_OK) == 0;
}
void waitForDisk(const char* path) {
  const char* folder = folderThatHangs();
  if (folder[0] == 0 || std::strncmp(path, folder, std::strlen(folder)) != 0) return;
  const int before = errno;
  while (hangs()) ::usleep(10'000);
  errno = before;
}
void waitForDisk(int file) {
  if (folderThatHangs()[0] == 0) return;
  char link[64], path[4096];
  std::snprintf(link, sizeof(link), "/proc/self/fd/%d", file);
  const long length = ::syscall(SYS_readlinkat, AT_FDCWD, link, path, sizeof(path) - 1);
  if (length < 0) return;
  path[length] = 0;
  waitForDisk(path);
}

bool fails(int file, const char* name, const Errors& errors) {
  waitForDisk(file);
  return file > STDERR_FILENO && fails(name, errors);
}

struct AtEnd {
  ~AtEnd() { report("calls", nullptr, calls.load()); }
} at_end;

/// The function of this name behind ours.
template <class Function>
Function behind(const char* name) {
  void* found = ::dlsym(RTLD_NEXT, name);
  Function function = nullptr;
  std::memcpy(&function, &found, sizeof(function));
  return function;
}

}  // namespace

// WRAP(NAME, ERRORS, RESULT ON FAILURE, RETURN TYPE, PARAMETERS, ARGUMENTS): the first parameter is a descriptor.
#define WRAP(name, errors, failure, type, parameters, arguments) \
  extern "C" type name parameters {                              \
    static const auto real = behind<type(*) parameters>(#name);  \
    if (fails(file, #name, errors)) return failure;              \
    return real arguments;                                       \
  }
#define WRAP_NOEXCEPT(name, errors, failure, type, parameters, arguments) \
  extern "C" type name parameters noexcept {                              \
    static const auto real = behind<type(*) parameters>(#name);           \
    if (fails(#name, errors)) return failure;                             \
    return real arguments;                                                \
  }

WRAP(read, kReads, -1, ssize_t, (int file, void* to, size_t count), (file, to, count))
WRAP(pread, kReads, -1, ssize_t, (int file, void* to, size_t count, off_t at), (file, to, count, at))
WRAP(pread64, kReads, -1, ssize_t, (int file, void* to, size_t count, off64_t at), (file, to, count, at))
WRAP(readv, kReads, -1, ssize_t, (int file, const iovec* to, int count), (file, to, count))
WRAP(preadv, kReads, -1, ssize_t, (int file, const iovec* to, int count, off_t at), (file, to, count, at))
WRAP(write, kWrites, -1, ssize_t, (int file, const void* from, size_t count), (file, from, count))
WRAP(pwrite, kWrites, -1, ssize_t, (int file, const void* from, size_t count, off_t at), (file, from, count, at))
WRAP(pwrite64, kWrites, -1, ssize_t, (int file, const void* from, size_t count, off64_t at), (file, from, count, at))
WRAP(writev, kWrites, -1, ssize_t, (int file, const iovec* from, int count), (file, from, count))
WRAP(fsync, kSyncs, -1, int, (int file), (file))
WRAP(fdatasync, kSyncs, -1, int, (int file), (file))
WRAP(accept, kAccepts, -1, int, (int file, sockaddr* address, socklen_t* length), (file, address, length))
WRAP(accept4, kAccepts, -1, int, (int file, sockaddr* address, socklen_t* length, int flags),
     (file, address, length, flags))
WRAP(recv, kReceives, -1, ssize_t, (int file, void* to, size_t count, int flags), (file, to, count, flags))
WRAP(recvmsg, kReceives, -1, ssize_t, (int file, msghdr* message, int flags), (file, message, flags))
WRAP(send, kSends, -1, ssize_t, (int file, const void* from, size_t count, int flags), (file, from, count, flags))
WRAP(sendmsg, kSends, -1, ssize_t, (int file, const msghdr* message, int flags), (file, message, flags))
WRAP(epoll_wait, kWaits, -1, int, (int file, epoll_event* events, int most, int timeout), (file, events, most, timeout))

WRAP_NOEXCEPT(mmap, kMaps, MAP_FAILED, void*,
              (void* at, size_t length, int protection, int flags, int file, off_t from),
              (at, length, protection, flags, file, from))
WRAP_NOEXCEPT(mmap64, kMaps, MAP_FAILED, void*,
              (void* at, size_t length, int protection, int flags, int file, off64_t from),
              (at, length, protection, flags, file, from))
WRAP_NOEXCEPT(socket, kMakes, -1, int, (int family, int type, int protocol), (family, type, protocol))
WRAP_NOEXCEPT(epoll_create1, kMakes, -1, int, (int flags), (flags))
WRAP_NOEXCEPT(eventfd, kMakes, -1, int, (unsigned count, int flags), (count, flags))

// The checked forms know the size of the buffer besides.
extern "C" ssize_t __read_chk(int file, void* to, size_t count, size_t) {
  return read(file, to, count);
}
extern "C" ssize_t __pread_chk(int file, void* to, size_t count, off_t at, size_t) {
  return pread(file, to, count, at);
}
extern "C" ssize_t __pread64_chk(int file, void* to, size_t count, off64_t at, size_t) {
  return pread64(file, to, count, at);
}
extern "C" ssize_t __recv_chk(int file, void* to, size_t count, size_t, int flags) {
  return recv(file, to, count, flags);
}

namespace {

int openAt(const char* name, int folder, const char* path, int flags, mode_t mode) {
  waitForDisk(path);
  if (fails(name, kOpens)) return -1;
  return static_cast<int>(::syscall(SYS_openat, folder, path, flags, mode));
}

int statOf(const char* path, void* status) {
  waitForDisk(path);
  return static_cast<int>(::syscall(SYS_newfstatat, AT_FDCWD, path, status, 0));
}

mode_t modeOf(int flags, va_list rest) {
  return (flags & (O_CREAT | O_TMPFILE)) != 0 ? va_arg(rest, mode_t) : 0;
}

}  // namespace

extern "C" int open(const char* path, int flags, ...) {
  va_list rest;
  va_start(rest, flags);
  const mode_t mode = modeOf(flags, rest);
  va_end(rest);
  return openAt("open", AT_FDCWD, path, flags, mode);
}
extern "C" int open64(const char* path, int flags, ...) {
  va_list rest;
  va_start(rest, flags);
  const mode_t mode = modeOf(flags, rest);
  va_end(rest);
  return openAt("open64", AT_FDCWD, path, flags | O_LARGEFILE, mode);
}
extern "C" int openat(int folder, const char* path, int flags, ...) {
  va_list rest;
  va_start(rest, flags);
  const mode_t mode = modeOf(flags, rest);
  va_end(rest);
  return openAt("openat", folder, path, flags, mode);
}
extern "C" int __open_2(const char* path, int flags) {
  return openAt("open", AT_FDCWD, path, flags, 0);
}
extern "C" int __open64_2(const char* path, int flags) {
  return openAt("open64", AT_FDCWD, path, flags | O_LARGEFILE, 0);
}
extern "C" int stat(const char* path, struct stat* status) noexcept {
  return statOf(path, status);
}
extern "C" int stat64(const char* path, struct stat64* status) noexcept {
  return statOf(path, status);
}
