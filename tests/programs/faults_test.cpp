// A server whose n-th call to a file, a socket or a map fails, n from its start to the end of a whole session. It never
// crashes: it ends at once with a line and status 1, or serves, and then whoever asks again is answered.
// LUMIGRID_FAULTS=all in the environment runs every n with both errors; without it, as many as take half a minute.
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <thread>

#include "tests/programs/run_program.h"
#include "tests/server/net/loopback.h"
#include "tests/server/net/served_scene.h"

namespace {

using nlohmann::json;
using server::HttpAnswer;
using server::LoopbackClient;

constexpr int kRunsInTests = 24;  // of each error

/// The fate of one server.
struct Trial {
  bool served = false;   ///< it printed its address
  bool answered = true;  ///< afterwards it answered somebody who asked three times at most
  int status = 0;        ///< as programs::wait has it; -1: it did not end
  std::string err;       ///< standard error
  std::string failed;    ///< name of the call that failed; empty: none did
  long calls = 0;        ///< of the whole process; 0 where it did not end by itself
};

class Faults : public programs::ProgramTest {
 protected:
  Trial serve(long at, int variant) {
    for (const char* name : {"serve.out", "serve.err", "report"}) std::filesystem::remove(path(name));
    const pid_t pid = startWith(at, variant);
    Trial trial;
    std::optional<int> ended;
    const std::uint16_t port = waitForPort(pid, ended);
    trial.served = port != 0;
    if (trial.served) {
      visit(port);
      trial.answered = isAnswered(port);
      ::kill(pid, SIGTERM);
    }
    if (!ended) ended = waitForEnd(pid);
    trial.status = ended.value_or(-1);
    trial.err = programs::readText(path("serve.err"));
    std::istringstream report(programs::readText(path("report")));
    for (std::string word, value; report >> word >> value;)
      if (word == "failed")
        trial.failed = value;
      else
        trial.calls = std::stol(value);
    return trial;
  }

 private:
  pid_t startWith(long at, int variant) {
    // The environment is the child's alone; threads of this process read none of these.
    const std::vector<std::pair<std::string, std::string>> environment{
        {"LD_PRELOAD", LUMIGRID_FAULT_LIBRARY},
        {"LUMIGRID_FAULT_AT", std::to_string(at)},
        {"LUMIGRID_FAULT_VARIANT", std::to_string(variant)},
        {"LUMIGRID_FAULT_REPORT", path("report")},
        {"ASAN_OPTIONS", "verify_asan_link_order=0"}};
    for (const auto& [name, value] : environment) ::setenv(name.c_str(), value.c_str(), 1);
    const pid_t pid = programs::start(
        "lumigrid", {"serve", scene_.path, "--port", "0", "--json", "--no-frames", "--web", "off"}, path("serve"));
    for (const auto& [name, value] : environment) ::unsetenv(name.c_str());
    return pid;
  }

  /// 0 where the server ended instead; `ended` is its status then.
  std::uint16_t waitForPort(pid_t pid, std::optional<int>& ended) const {
    for (int i = 0; i < 4000; ++i) {
      const json j = json::parse(programs::readText(path("serve.out")), nullptr, false);
      if (j.is_object()) return j["port"].get<std::uint16_t>();
      int status = 0;
      if (::waitpid(pid, &status, WNOHANG) == pid) {
        ended = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
        return 0;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return 0;
  }

  /// The write that failed may have been the one by which Asio's handler passes the signal on. So whoever ends the
  /// server asks again after three seconds.
  static std::optional<int> waitForEnd(pid_t pid) {
    for (int i = 0; i < 4000; ++i) {
      if (i == 600) ::kill(pid, SIGTERM);
      int status = 0;
      if (::waitpid(pid, &status, WNOHANG) == pid)
        return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    ::kill(pid, SIGKILL);
    ::waitpid(pid, nullptr, 0);
    return std::nullopt;
  }

  /// A whole session: small answers, a range of a file, and a view until it is complete. Any of them may fail.
  static void visit(std::uint16_t port) {
    (void)server::httpRequest(port, "/healthz");
    (void)server::httpRequest(port, "/scene.json");
    (void)server::httpRequest(port, "/patch.lgp", {{"Range", "bytes=0-9999"}});
    const auto client = LoopbackClient::connect(port);
    if (!client || !client->send(protocol::Hello{protocol::kVersion, "faults 1"})) return;
    const auto greeting = client->receive();
    const auto* welcome = greeting ? std::get_if<protocol::Welcome>(&*greeting) : nullptr;
    if (welcome == nullptr || !client->send(server::viewOf(*welcome, 1))) return;
    while (const auto message = client->receive())
      if (std::holds_alternative<protocol::Completion>(*message)) break;
    client->close();
  }

  static bool isAnswered(std::uint16_t port) {
    for (int i = 0; i < 3; ++i)
      if (server::httpRequest(port, "/healthz").status == 200) return true;
    return false;
  }

  const server::SceneDirectory scene_;
};

TEST_F(Faults, serversSurviveAnyCallThatFails) {
  const Trial without = serve(-1, 0);
  ASSERT_TRUE(without.served && without.answered) << without.err;
  ASSERT_EQ(without.status, 0) << without.err;
  ASSERT_GT(without.calls, 40) << "too few calls come by the library";

  const char* all = std::getenv("LUMIGRID_FAULTS");
  const bool every = all != nullptr && std::string(all) == "all";
  const long step = every ? 1 : std::max(1L, without.calls / kRunsInTests);
  int stopped = 0, survived = 0;
  for (int variant = 0; variant < 2; ++variant) {
    // The two errors are tried at different calls.
    for (long at = variant * step / 2; at < without.calls; at += step) {
      const Trial trial = serve(at, variant);
      SCOPED_TRACE("call " + std::to_string(at) + ", " + trial.failed + ", error " + std::to_string(variant) + ":\n" +
                   trial.err);
      EXPECT_EQ(trial.err.find("Sanitizer"), std::string::npos);
      if (!trial.served) {
        ++stopped;
        EXPECT_EQ(trial.status, 1);
        EXPECT_NE(trial.err.find("lumigrid: "), std::string::npos);
      } else {
        ++survived;
        EXPECT_EQ(trial.status, 0);
        EXPECT_TRUE(trial.answered);
      }
    }
  }
  EXPECT_GT(survived, 0);
  std::printf("%ld calls; of %d servers %d did not start and said so\n", without.calls, stopped + survived, stopped);
}

}  // namespace
