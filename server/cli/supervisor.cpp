#include "server/cli/supervisor.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/signalfd.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <vector>

#include "base/stopwatch.h"
#include "spdlog/spdlog.h"

namespace server::cli {
namespace {

constexpr double kSoon = 10.0;  // seconds; a worker that ended earlier is started again after a longer pause
constexpr double kFirstPause = 0.5, kLongestPause = 30.0;

struct Process {
  pid_t pid = 0;  // 0: not running
  base::Stopwatch since;
  double pause = 0.0;     // seconds until it is started again
  double start_at = 0.0;  // seconds of the supervisor's clock
};

/// The signals that the supervisor reads one by one.
sigset_t watchedSignals() {
  sigset_t set;
  sigemptyset(&set);
  for (const int signal : {SIGTERM, SIGINT, SIGHUP, SIGCHLD}) sigaddset(&set, signal);
  return set;
}

int statusOf(int waited) {
  return WIFEXITED(waited) ? WEXITSTATUS(waited) : 1;
}

class Supervisor {
 public:
  Supervisor(unsigned count, const Worker& worker, const std::function<void()>& on_hangup)
      : worker_(worker), on_hangup_(on_hangup), processes_(count) {
    const sigset_t watched = watchedSignals();
    sigprocmask(SIG_BLOCK, &watched, &before_);
    signals_ = base::FileDescriptor(::signalfd(-1, &watched, SFD_CLOEXEC));
  }
  ~Supervisor() { sigprocmask(SIG_SETMASK, &before_, nullptr); }
  Supervisor(const Supervisor&) = delete;
  Supervisor& operator=(const Supervisor&) = delete;

  /// Starts a worker and waits until it is ready. False: it ended before, and `status` says how.
  bool startAndWait(unsigned number, int& status) {
    int ends[2];
    if (::pipe2(ends, O_CLOEXEC) != 0) return status = 1, false;
    base::FileDescriptor reads(ends[0]);
    start(number, base::FileDescriptor(ends[1]));
    if (processes_[number].pid < 0) return status = 1, false;
    starting_ = static_cast<std::ptrdiff_t>(number);
    const bool is_ready = waitUntilReady(reads);
    starting_ = -1;
    if (is_ready) return true;
    int waited = 0;
    Process& ended = processes_[number];
    if (ended.pid > 0 && ::waitpid(ended.pid, &waited, 0) == ended.pid) start_status_ = statusOf(waited);
    ended.pid = 0;
    status = start_status_;
    return false;
  }
  bool isStopping() const { return stopping_; }

  int run() {
    while (!stopping_ || anyRuns()) {
      pollfd wanted{signals_.get(), POLLIN, 0};
      const int milliseconds = untilNextStart();
      if (::poll(&wanted, 1, milliseconds) > 0) acceptSignal();
      if (!stopping_) startThoseDue();
    }
    return status_;
  }

  void stopAll(int signal) {
    stopping_ = true;
    handOn(signal);
  }

 private:
  /// The end of the pipe comes when the worker's process does. Signals are heard meanwhile.
  bool waitUntilReady(const base::FileDescriptor& reads) {
    for (;;) {
      std::array<pollfd, 2> wanted{pollfd{reads.get(), POLLIN, 0}, pollfd{signals_.get(), POLLIN, 0}};
      if (::poll(wanted.data(), wanted.size(), -1) < 0) {
        if (errno != EINTR) return false;
        continue;
      }
      char ready = 0;
      if (wanted[0].revents != 0) return ::read(reads.get(), &ready, 1) == 1;
      if (wanted[1].revents != 0) acceptSignal();
    }
  }

  /// The worker tells through `ready`, where there is one, that it accepts connections.
  void start(unsigned number, base::FileDescriptor ready = base::FileDescriptor()) {
    Process& process = processes_[number];
    process.since = {};
    const pid_t parent = ::getpid();
    process.pid = ::fork();
    if (process.pid < 0) process.start_at = clock_.seconds() + kFirstPause;  // perhaps the system has room then
    if (process.pid != 0) return;
    ::prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (::getppid() != parent) ::_exit(1);  // it died before the line above
    sigprocmask(SIG_SETMASK, &before_, nullptr);
    signals_ = base::FileDescriptor();
    const int status = worker_(number, [&ready] {
      const char one = 1;
      if (ready && ::write(ready.get(), &one, 1) != 1)
        spdlog::warn("the supervisor does not hear that a worker is ready");
    });
    std::exit(status);
  }

  bool anyRuns() const {
    return std::any_of(processes_.begin(), processes_.end(), [](const Process& one) { return one.pid > 0; });
  }

  /// Milliseconds to wait for signals; -1: as long as it takes.
  int untilNextStart() const {
    double least = std::numeric_limits<double>::infinity();
    for (const Process& process : processes_)
      if (process.pid <= 0 && !stopping_) least = std::min(least, process.start_at - clock_.seconds());
    return std::isinf(least) ? -1 : static_cast<int>(std::ceil(1e3 * std::max(0.0, least)));
  }

  void startThoseDue() {
    for (unsigned i = 0; i < processes_.size(); ++i)
      if (processes_[i].pid <= 0 && processes_[i].start_at <= clock_.seconds()) start(i);
  }

  void acceptSignal() {
    signalfd_siginfo info{};
    if (::read(signals_.get(), &info, sizeof info) != static_cast<ssize_t>(sizeof info)) return;
    const int signal = static_cast<int>(info.ssi_signo);
    if (signal == SIGCHLD) return acceptEnds();
    stopping_ = stopping_ || signal != SIGHUP;
    if (signal == SIGHUP) on_hangup_();
    handOn(signal);
  }

  void handOn(int signal) {
    for (const Process& process : processes_)
      if (process.pid > 0) ::kill(process.pid, signal);
  }

  void acceptEnds() {
    int waited = 0;
    for (pid_t pid = 0; (pid = ::waitpid(-1, &waited, WNOHANG)) > 0;) {
      const auto process =
          std::find_if(processes_.begin(), processes_.end(), [pid](const Process& one) { return one.pid == pid; });
      if (process == processes_.end()) continue;
      process->pid = 0;
      if (process - processes_.begin() == starting_) {
        start_status_ = statusOf(waited);
        continue;
      }
      if (stopping_) {
        // One that was told to end before it could listen for that ended well.
        const int signal = WIFSIGNALED(waited) ? WTERMSIG(waited) : 0;
        if (signal != SIGTERM && signal != SIGINT) status_ = std::max(status_, statusOf(waited));
        continue;
      }
      const bool was_soon = process->since.seconds() < kSoon;
      process->pause = was_soon ? std::clamp(2.0 * process->pause, kFirstPause, kLongestPause) : kFirstPause;
      process->start_at = clock_.seconds() + process->pause;
      const std::string how = WIFSIGNALED(waited) ? "by signal " + std::to_string(WTERMSIG(waited))
                                                  : "with status " + std::to_string(statusOf(waited));
      spdlog::error("worker {} ended {}; it is started again in {:.1f} seconds", process - processes_.begin(), how,
                    process->pause);
    }
  }

  const Worker& worker_;
  const std::function<void()>& on_hangup_;
  std::vector<Process> processes_;
  sigset_t before_{};
  base::FileDescriptor signals_;
  const base::Stopwatch clock_;
  bool stopping_ = false;
  std::ptrdiff_t starting_ = -1;  // the worker that startAndWait() waits for
  int start_status_ = 1;          // of one that ended meanwhile
  int status_ = 0;
};

}  // namespace

base::Result<KeptPort> keepPort(const std::string& address, std::uint16_t port) {
  sockaddr_storage storage{};
  socklen_t size = 0;
  auto* const four = reinterpret_cast<sockaddr_in*>(&storage);
  auto* const six = reinterpret_cast<sockaddr_in6*>(&storage);
  if (::inet_pton(AF_INET, address.c_str(), &four->sin_addr) == 1) {
    four->sin_family = AF_INET, four->sin_port = htons(port), size = sizeof *four;
  } else if (::inet_pton(AF_INET6, address.c_str(), &six->sin6_addr) == 1) {
    six->sin6_family = AF_INET6, six->sin6_port = htons(port), size = sizeof *six;
  } else {
    return base::Error{base::ErrorCode::kInvalidInput,
                       "'" + address +
                           "' is no IP address; use 127.0.0.1 for this machine alone or 0.0.0.0 for all "
                           "its networks"};
  }
  KeptPort kept{base::FileDescriptor(::socket(storage.ss_family, SOCK_STREAM | SOCK_CLOEXEC, 0)), 0};
  const int on = 1;
  ::setsockopt(kept.socket.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  ::setsockopt(kept.socket.get(), SOL_SOCKET, SO_REUSEPORT, &on, sizeof on);
  auto* const any = reinterpret_cast<sockaddr*>(&storage);
  if (::bind(kept.socket.get(), any, size) != 0 || ::getsockname(kept.socket.get(), any, &size) != 0)
    return base::Error{base::ErrorCode::kNetwork, "cannot listen at " + address + ":" + std::to_string(port) + ": " +
                                                      std::strerror(errno) + "; choose another port with --port"};
  kept.port = ntohs(storage.ss_family == AF_INET ? four->sin_port : six->sin6_port);
  return kept;
}

int supervise(unsigned count, const Worker& worker, const std::function<void()>& all_ready,
              const std::function<void()>& on_hangup) {
  Supervisor supervisor(count, worker, on_hangup);
  for (unsigned number = 0; number < count; ++number) {
    int status = 0;
    if (supervisor.startAndWait(number, status)) continue;
    if (supervisor.isStopping()) return supervisor.run();
    supervisor.stopAll(SIGTERM);
    supervisor.run();
    return status;
  }
  all_ready();
  return supervisor.run();
}

}  // namespace server::cli
