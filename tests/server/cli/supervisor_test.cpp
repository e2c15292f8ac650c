#include "server/cli/supervisor.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <set>
#include <string>

namespace server::cli {
namespace {

/// A pipe by which workers tell the test who they are.
class Notes {
 public:
  Notes() { EXPECT_EQ(::pipe(ends_.data()), 0); }
  ~Notes() {
    ::close(ends_[0]);
    ::close(ends_[1]);
  }
  Notes(const Notes&) = delete;
  Notes& operator=(const Notes&) = delete;
  void write(pid_t pid) const { EXPECT_EQ(::write(ends_[1], &pid, sizeof pid), static_cast<ssize_t>(sizeof pid)); }
  pid_t read() const {
    pid_t pid = 0;
    EXPECT_EQ(::read(ends_[0], &pid, sizeof pid), static_cast<ssize_t>(sizeof pid));
    return pid;
  }

 private:
  std::array<int, 2> ends_{};
};

/// Runs the supervisor in a process of its own, since it waits for signals.
pid_t startSupervisor(unsigned count, const Worker& worker) {
  const pid_t pid = ::fork();
  if (pid == 0)
    ::_exit(supervise(
        count, worker, [] {}, [] {}));
  return pid;
}

int waitFor(pid_t pid) {
  int waited = 0;
  EXPECT_EQ(::waitpid(pid, &waited, 0), pid);
  return WIFEXITED(waited) ? WEXITSTATUS(waited) : -1;
}

sigset_t endSignal() {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGTERM);
  return set;
}

/// Serves nothing, and ends by a signal, which is not missed once `begun` is called.
int serveUntilEnd(const std::function<void()>& begun) {
  const sigset_t set = endSignal();
  sigprocmask(SIG_BLOCK, &set, nullptr);
  begun();
  int signal = 0;
  sigwait(&set, &signal);
  return 0;
}

TEST(Supervisor, aWorkerThatCannotStartEndsAll) {
  const Notes notes;
  const pid_t supervisor = startSupervisor(3, [&](unsigned, const auto&) {
    notes.write(::getpid());
    return 3;
  });
  EXPECT_EQ(waitFor(supervisor), 3);
  notes.read();  // of the first; the others were not started, so nothing follows it
  notes.write(42);
  EXPECT_EQ(notes.read(), 42);
}

TEST(Supervisor, killedWorkersAreStartedAgainAndSignalsAreHandedOn) {
  const Notes notes;
  const pid_t supervisor = startSupervisor(2, [&](unsigned, const std::function<void()>& ready) {
    return serveUntilEnd([&] {
      ready();
      notes.write(::getpid());
    });
  });
  std::set<pid_t> workers{notes.read(), notes.read()};
  EXPECT_EQ(workers.size(), 2U);
  ::kill(*workers.begin(), SIGKILL);
  const pid_t again = notes.read();
  EXPECT_TRUE(workers.insert(again).second);
  ::kill(supervisor, SIGTERM);
  EXPECT_EQ(waitFor(supervisor), 0);
  for (const pid_t worker : workers) EXPECT_NE(::kill(worker, 0), 0);
}

// A supervisor that is killed leaves no worker behind.
TEST(Supervisor, workersEndWithTheSupervisor) {
  const Notes notes;
  const pid_t supervisor = startSupervisor(1, [&](unsigned, const std::function<void()>& ready) {
    const int status = serveUntilEnd([&] {
      ready();
      notes.write(::getpid());
    });
    notes.write(43);
    return status;
  });
  notes.read();
  ::kill(supervisor, SIGKILL);
  waitFor(supervisor);
  EXPECT_EQ(notes.read(), 43);
}

TEST(Supervisor, aPortIsKeptForThoseWhoShareIt) {
  const auto kept = keepPort("127.0.0.1", 0);
  ASSERT_TRUE(kept) << kept.error().message;
  EXPECT_GT(kept->port, 0);
  EXPECT_TRUE(keepPort("127.0.0.1", kept->port));
  EXPECT_EQ(keepPort("somewhere", 0).error().code, base::ErrorCode::kInvalidInput);
  EXPECT_EQ(keepPort("192.0.2.1", 0).error().code, base::ErrorCode::kNetwork);
}

}  // namespace
}  // namespace server::cli
