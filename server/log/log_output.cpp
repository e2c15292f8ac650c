#include "server/log/log_output.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <thread>
#include <utility>

#include "server/log/log_text.h"

namespace server {
namespace {

// After a descriptor that said it was ready took nothing: asking again at once would spin.
constexpr auto kPause = std::chrono::milliseconds(10);
constexpr mode_t kLogMode = 0640;  // addresses of visitors are not everybody's business

/// Non-blocking, so that a named pipe without a reader is an error in place of a wait.
base::Result<int> openForAppending(const std::string& path) {
  const int descriptor =
      ::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC | O_NOCTTY | O_NONBLOCK, kLogMode);
  if (descriptor >= 0) return descriptor;
  return base::Error{base::ErrorCode::kIo, "cannot write the log to " + path + ": " + std::strerror(errno) +
                                               "; name another file with --log"};
}

}  // namespace

base::Result<LogOutput> LogOutput::openFile(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(const int descriptor, openForAppending(path));
  LogOutput output(descriptor);
  output.path_ = path;
  return output;
}

LogOutput::LogOutput(LogOutput&& other) noexcept
    : descriptor_(other.descriptor_), path_(std::exchange(other.path_, {})), error_(other.error_) {}

LogOutput::~LogOutput() {
  if (!path_.empty()) ::close(descriptor_);
}

LogOutput::Outcome LogOutput::write(std::string_view& rest, std::chrono::milliseconds patience) {
  const auto deadline = std::chrono::steady_clock::now() + patience;
  while (!rest.empty()) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now());
    pollfd writable{descriptor_, POLLOUT, 0};
    const int ready = ::poll(&writable, 1, static_cast<int>(std::max<long>(left.count(), 0)));
    if (ready == 0) return Outcome::kBusy;
    const long written = ready < 0 ? -1 : writeSome(rest.substr(0, kMaxLogLine));
    if (written > 0) {
      rest.remove_prefix(static_cast<std::size_t>(written));
    } else if (written == 0 || errno == EAGAIN || errno == EWOULDBLOCK) {
      std::this_thread::sleep_for(kPause);
      return Outcome::kBusy;
    } else if (errno != EINTR) {
      error_ = errno;
      return Outcome::kFailed;
    }
  }
  return Outcome::kWritten;
}

/// A socket can have room for a byte and wait for the rest, so it is asked not to; other descriptors have no such
/// question, and a pipe that is ready has room for a whole line.
long LogOutput::writeSome(std::string_view bytes) const {
  const ssize_t sent = ::send(descriptor_, bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
  if (sent >= 0 || errno != ENOTSOCK) return sent;
  return ::write(descriptor_, bytes.data(), bytes.size());
}

base::Result<void> LogOutput::reopen() {
  if (path_.empty()) return {};
  LUMIGRID_ASSIGN_OR_RETURN(const int descriptor, openForAppending(path_));
  ::close(descriptor_);
  descriptor_ = descriptor;
  return {};
}

}  // namespace server
