#include "server/bake/draw_processes.h"

#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>
#include <cerrno>

#include <algorithm>
#include <array>
#include <condition_variable>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "server/bake/draw_messages.h"

namespace server {
namespace {

constexpr unsigned kMaxProcesses = 16;
constexpr std::size_t kJobsAtATime = 2;  // one is drawn, the next is there already
constexpr unsigned kMaxDeaths = 3;       // of processes over the same faces

// ---- A process ----

/// The environment with llvmpipe's own threads left out, unless somebody has chosen them: the processes fill the cores,
/// and each of its threads costs more than it gives then.
std::vector<std::string> environmentOfProcess() {
  std::vector<std::string> all;
  for (char** variable = environ; *variable != nullptr; ++variable) all.emplace_back(*variable);
  if (std::getenv("LP_NUM_THREADS") == nullptr) all.emplace_back("LP_NUM_THREADS=1");
  return all;
}

std::vector<char*> pointersTo(std::vector<std::string>& words) {
  std::vector<char*> pointers;
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  return pointers;
}

class DrawProcess {
 public:
  static base::Result<std::unique_ptr<DrawProcess>> start(std::vector<std::string> command, base::ByteView order) {
    std::array<int, 2> ends{};
    if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0)
      return base::Error{base::ErrorCode::kIo, std::string("no socket to a drawing process: ") + std::strerror(errno)};
    std::vector<std::string> environment = environmentOfProcess();
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, ends[1], STDIN_FILENO);
    posix_spawn_file_actions_adddup2(&actions, STDERR_FILENO, STDOUT_FILENO);
    pid_t pid = -1;
    const int failed = ::posix_spawn(&pid, command.front().c_str(), &actions, nullptr, pointersTo(command).data(),
                                     pointersTo(environment).data());
    posix_spawn_file_actions_destroy(&actions);
    ::close(ends[1]);
    std::unique_ptr<DrawProcess> process(new DrawProcess(ends[0], failed == 0 ? pid : -1));
    if (failed != 0)
      return base::Error{base::ErrorCode::kIo,
                         command.front() + ": cannot start a drawing process: " + std::strerror(failed)};
    // One that is dead already shows when an answer is waited for.
    static_cast<void>(sendMessage(process->socket_, DrawMessageKind::kOrder, order));
    return process;
  }
  /// Ends it and waits for that.
  ~DrawProcess() {
    end();
    ::close(socket_);
  }
  DrawProcess(const DrawProcess&) = delete;
  DrawProcess& operator=(const DrawProcess&) = delete;

  int socket() const { return socket_; }
  /// Nothing is said to it any more, on which it ends, and how: "signal 11 (Segmentation fault)".
  std::string end() {
    if (pid_ <= 0) return "";
    ::shutdown(socket_, SHUT_RDWR);
    int status = 0;
    while (::waitpid(std::exchange(pid_, -1), &status, 0) < 0 && errno == EINTR) {
    }
    if (!WIFSIGNALED(status)) return "status " + std::to_string(WEXITSTATUS(status));
    return "signal " + std::to_string(WTERMSIG(status)) + " (" + ::strsignal(WTERMSIG(status)) + ")";
  }

 private:
  DrawProcess(int socket, pid_t pid) : socket_(socket), pid_(pid) {}
  int socket_;
  pid_t pid_;
};

// ---- Who gives them work ----

class MadeByProcesses : public FaceMaker {
 public:
  MadeByProcesses(const FaceWork& work, std::vector<std::string> command, unsigned processes, Take take, Fail fail)
      : command_(std::move(command)), order_(encodeOrder(work)), take_(std::move(take)), fail_(std::move(fail)) {
    for (unsigned i = 0; i < processes; ++i) threads_.emplace_back([this] { serveAll(); });
  }
  ~MadeByProcesses() override { MadeByProcesses::finish(); }

  void submit(DrawJob job) override {
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return failed_ || !next_; });
      if (failed_) return;
      next_ = std::move(job);
    }
    changed_.notify_all();
  }
  void finish() override {
    {
      const std::lock_guard lock(mutex_);
      finishing_ = true;
    }
    changed_.notify_all();
    for (std::thread& thread : threads_)
      if (thread.joinable()) thread.join();
  }

 private:
  /// The jobs that one process has; faces that have come are taken out of the first.
  using Jobs = std::deque<DrawJob>;

  // A thread's work: one process after the other, as long as they die.
  void serveAll() {
    Jobs jobs;
    for (unsigned deaths = 0;;) {
      const std::uint64_t before = jobs.empty() ? 0 : jobs.front().sequence;
      const base::Result<void> served = serve(jobs);
      if (served) return;
      deaths = !jobs.empty() && jobs.front().sequence == before ? deaths + 1 : 1;
      if (served.error().code == base::ErrorCode::kNetwork && deaths < kMaxDeaths) continue;
      return stop(served.error());
    }
  }

  // Until all is done, or an error; kNetwork: the process has died.
  base::Result<void> serve(Jobs& jobs) {
    if (jobs.empty()) {
      auto first = takeJob(true);
      if (!first) return {};
      jobs.push_back(std::move(*first));
    }
    LUMIGRID_ASSIGN_OR_RETURN(auto process, DrawProcess::start(command_, order_));
    for (const DrawJob& job : jobs) give(*process, job);
    for (;;) {
      while (jobs.size() < kJobsAtATime) {
        auto job = takeJob(jobs.empty());
        if (!job) break;
        give(*process, *job);
        jobs.push_back(std::move(*job));
      }
      if (jobs.empty()) return {};
      LUMIGRID_TRY(takeFace(*process, jobs));
    }
  }

  // A process that cannot be told anything is dead, which shows when its answer is waited for.
  static void give(DrawProcess& process, const DrawJob& job) {
    static_cast<void>(sendMessage(process.socket(), DrawMessageKind::kJob, encodeJob(job)));
  }

  base::Result<void> takeFace(DrawProcess& process, Jobs& jobs) {
    auto message = receiveMessage(process.socket());
    if (!message || !*message)
      return base::Error{base::ErrorCode::kNetwork, "a drawing process ended by " + process.end() +
                                                        " several times over the same image, " +
                                                        repository::nameOf(jobs.front().keys.front())};
    if ((*message)->kind == DrawMessageKind::kError) return decodeError((*message)->body);
    LUMIGRID_ASSIGN_OR_RETURN(auto made, decodeMadeFace((*message)->body));
    DrawJob& job = jobs.front();
    if ((*message)->kind != DrawMessageKind::kFace || made.sequence != job.sequence)
      return base::Error{base::ErrorCode::kIo, "a drawing process answers with what it was not asked for"};
    take_(job.sequence, job.keys.front(), std::move(made.face));
    ++job.sequence;
    job.keys.erase(job.keys.begin());
    if (job.keys.empty()) jobs.pop_front();
    return {};
  }

  // Nothing: none is waiting, or (having waited) there will be none any more.
  std::optional<DrawJob> takeJob(bool wait) {
    std::optional<DrawJob> job;
    {
      std::unique_lock lock(mutex_);
      if (wait) changed_.wait(lock, [&] { return finishing_ || failed_ || next_; });
      job = std::exchange(next_, std::nullopt);
    }
    if (job) changed_.notify_all();
    return job;
  }

  void stop(const base::Error& error) {
    {
      const std::lock_guard lock(mutex_);
      if (std::exchange(failed_, true)) return;
      next_.reset();
    }
    changed_.notify_all();
    fail_(error);
  }

  const std::vector<std::string> command_;
  const base::Bytes order_;
  const Take take_;
  const Fail fail_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<DrawJob> next_;
  bool finishing_ = false;
  bool failed_ = false;
  std::vector<std::thread> threads_;  // last: they use the others
};

// ---- Within the process ----

base::Result<void> drawFor(int socket, const Encode& encode) {
  LUMIGRID_ASSIGN_OR_RETURN(auto first, receiveMessage(socket));
  if (!first || first->kind != DrawMessageKind::kOrder)
    return base::Error{base::ErrorCode::kInvalidInput, "the first message to a drawing process is no order"};
  LUMIGRID_ASSIGN_OR_RETURN(auto order, decodeOrder(first->body));
  LUMIGRID_ASSIGN_OR_RETURN(auto patches, lod::patch::PatchFile::open(order.patch_path));

  // Faces come from one thread that encodes, so in order.
  const FaceWork work{order.scene,           patches, order.grid, order.render, order.quality, order.subsampling,
                      order.gpu_budget_bytes};
  std::mutex mutex;
  std::optional<base::Error> failed;
  const auto fail = [&](const base::Error& error) {
    const std::lock_guard lock(mutex);
    if (!failed) failed = error;
  };
  const auto faces = makeFacesHere(
      work, 1,
      [&](std::uint64_t sequence, const repository::FaceKey&, const EncodedFace& face) {
        if (const auto sent = sendMessage(socket, DrawMessageKind::kFace, encodeMadeFace(sequence, face)); !sent)
          fail(sent.error());
      },
      [&](const base::Error& error) {
        fail(error);
        ::shutdown(socket, SHUT_RD);  // the next job is not waited for
      },
      encode);
  for (auto message = receiveMessage(socket); message && *message; message = receiveMessage(socket)) {
    auto job = decodeJob((*message)->body);
    if (!job) fail(job.error());
    if (!job) break;
    faces->submit(std::move(*job));
  }
  faces->finish();
  return failed ? base::Result<void>(*failed) : base::Result<void>();
}

}  // namespace

int runDrawProcess(int socket, const Encode& encode) {
  // The terminal's Ctrl-C and a batch engine's SIGTERM reach the whole group. The bake decides what is still drawn.
  ::signal(SIGINT, SIG_IGN);
  ::signal(SIGTERM, SIG_IGN);
  const auto drawn = drawFor(socket, encode);
  if (drawn) return 0;
  static_cast<void>(sendMessage(socket, DrawMessageKind::kError, encodeError(drawn.error())));
  return 1;
}

std::unique_ptr<FaceMaker> makeFacesByProcesses(const FaceWork& work, const std::vector<std::string>& command,
                                                unsigned processes, FaceMaker::Take take, FaceMaker::Fail fail) {
  return std::make_unique<MadeByProcesses>(work, command, processes, std::move(take), std::move(fail));
}

unsigned drawProcessesFor(unsigned threads) {
  return std::clamp(threads, 1U, kMaxProcesses);
}

}  // namespace server
