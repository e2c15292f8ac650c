#include "server/bake/draw_processes.h"

#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>
#include <cerrno>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <filesystem>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "base/memory.h"
#include "lod/texture/format.h"
#include "server/bake/draw_messages.h"
#include "server/render/page_meshes.h"

namespace server {
namespace {

constexpr unsigned kMaxProcesses = 16;   // a choice; each takes 50 to 400 MB (draw_memory.cpp)
constexpr std::size_t kJobsAtATime = 2;  // one is drawn, the next is there already
constexpr unsigned kMaxDeaths = 3;       // processes that may die over the same faces

/// The environment with one thread for llvmpipe, unless somebody has chosen their number: the processes fill the cores,
/// and further threads cost more than they give then.
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
    // A process that is dead already shows when its answer is waited for.
    static_cast<void>(sendMessage(process->socket_, DrawMessageKind::kOrder, order));
    return process;
  }
  /// Ends the process and waits for that.
  ~DrawProcess() {
    end();
    ::close(socket_);
  }
  DrawProcess(const DrawProcess&) = delete;
  DrawProcess& operator=(const DrawProcess&) = delete;

  int socket() const { return socket_; }
  /// Closes the connection, upon which the process ends, and says how it ended: "signal 11 (Segmentation fault)".
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

class ProcessFaceMaker : public FaceMaker {
 public:
  ProcessFaceMaker(const FaceWork& work, std::vector<std::string> command, unsigned processes, OnFace on_face,
                   OnError on_error)
      : command_(std::move(command)),
        order_(encodeOrder(work)),
        on_face_(std::move(on_face)),
        on_error_(std::move(on_error)) {
    for (unsigned i = 0; i < processes; ++i) threads_.emplace_back([this] { superviseProcesses(); });
  }
  ~ProcessFaceMaker() override { ProcessFaceMaker::finish(); }

  void submit(DrawJob job) override { waiting_.submit(std::move(job)); }
  void finish() override {
    waiting_.finish();
    for (std::thread& thread : threads_)
      if (thread.joinable()) thread.join();
  }

 private:
  /// The jobs that one process has, without the faces of the first that it has delivered.
  using Jobs = std::deque<DrawJob>;

  // Each thread runs this: it starts one process after the other, as long as they die.
  void superviseProcesses() {
    Jobs jobs;
    for (unsigned deaths = 0;;) {
      const std::uint64_t before = jobs.empty() ? 0 : jobs.front().sequence;
      const base::Result<void> served = superviseProcess(jobs);
      if (served) return;
      deaths = !jobs.empty() && jobs.front().sequence == before ? deaths + 1 : 1;
      if (served.error().code == base::ErrorCode::kNetwork && deaths < kMaxDeaths) continue;
      if (waiting_.fail()) on_error_(served.error());
      return;
    }
  }

  // Returns when all is done, or with an error; kNetwork: the process has died.
  base::Result<void> superviseProcess(Jobs& jobs) {
    if (jobs.empty()) {
      auto first = waiting_.takeJob(true);
      if (!first) return {};
      jobs.push_back(std::move(*first));
    }
    LUMIGRID_ASSIGN_OR_RETURN(auto process, DrawProcess::start(command_, order_));
    for (const DrawJob& job : jobs) sendJob(*process, job);
    for (;;) {
      while (jobs.size() < kJobsAtATime) {
        auto job = waiting_.takeJob(jobs.empty());
        if (!job) break;
        sendJob(*process, *job);
        jobs.push_back(std::move(*job));
      }
      if (jobs.empty()) return {};
      LUMIGRID_TRY(receiveFace(*process, jobs));
    }
  }

  // Where this fails the process is dead, which shows when its answer is waited for.
  static void sendJob(DrawProcess& process, const DrawJob& job) {
    static_cast<void>(sendMessage(process.socket(), DrawMessageKind::kJob, encodeJob(job)));
  }

  base::Result<void> receiveFace(DrawProcess& process, Jobs& jobs) {
    auto message = receiveMessage(process.socket());
    if (!message || !*message)
      return base::Error{base::ErrorCode::kNetwork, "a drawing process ended by " + process.end() +
                                                        " several times over the same image, " +
                                                        repository::nameOf(jobs.front().keys.front())};
    if ((*message)->kind == DrawMessageKind::kError) return decodeError((*message)->body);
    LUMIGRID_ASSIGN_OR_RETURN(auto answer, decodeNumberedFace((*message)->body));
    DrawJob& job = jobs.front();
    if ((*message)->kind != DrawMessageKind::kFace || answer.sequence != job.sequence)
      return base::Error{base::ErrorCode::kIo, "a drawing process answers with what it was not asked for"};
    on_face_(job.sequence, job.keys.front(), std::move(answer.face));
    ++job.sequence;
    job.keys.erase(job.keys.begin());
    if (job.keys.empty()) jobs.pop_front();
    return {};
  }

  const std::vector<std::string> command_;
  const base::Bytes order_;
  const OnFace on_face_;
  const OnError on_error_;
  JobSlot waiting_;
  std::vector<std::thread> threads_;  // last: they use the others
};

/// Whether all pages of textures, as fine as they are, take at most half of the budget, so that none is given up for
/// another; also where there are none.
base::Result<bool> allPagesStay(const DrawOrder& order) {
  const auto file = base::partFile(order.scene, "texture", ".lgt");
  if (!file) return true;
  const std::filesystem::path folder = std::filesystem::path(order.patch_path).parent_path();
  LUMIGRID_ASSIGN_OR_RETURN(const auto textures, lod::texture::TextureFile::open(folder / *file));
  std::uint64_t bytes = 0;
  for (const lod::texture::PageRecord& page : textures.pages()) bytes += PageMeshes::bytesFor(page, 0);
  return bytes <= order.gpu_budget_bytes / 2;
}

base::Result<void> serveBake(int socket, const Encode& encode) {
  LUMIGRID_ASSIGN_OR_RETURN(auto first, receiveMessage(socket));
  if (!first || first->kind != DrawMessageKind::kOrder)
    return base::Error{base::ErrorCode::kInvalidInput, "the first message to a drawing process is no order"};
  LUMIGRID_ASSIGN_OR_RETURN(auto order, decodeOrder(first->body));
  LUMIGRID_ASSIGN_OR_RETURN(auto patches, lod::patch::PatchFile::open(order.patch_path));
  // Pages that come and go have tens of megabytes each: kept blocks would cost a third of a ceiling of 1 GB. Where no
  // page is given up, what else is large comes and goes in the same sizes, and fetching it anew would cost a seventh of
  // a bake's time.
  LUMIGRID_ASSIGN_OR_RETURN(const bool all_stay, allPagesStay(order));
  if (!all_stay) base::returnLargeBlocks();

  // One thread encodes, so faces come in order.
  const FaceWork work{order.scene,
                      patches,
                      order.grid,
                      order.render,
                      order.quality,
                      order.subsampling,
                      order.gpu_budget_bytes,
                      order.codec,
                      order.tiles ? &*order.tiles : nullptr};
  std::mutex mutex;
  std::optional<base::Error> failed;
  const auto fail = [&](const base::Error& error) {
    const std::lock_guard lock(mutex);
    if (!failed) failed = error;
  };
  const auto faces = makeLocalFaceMaker(
      work, 1,
      [&](std::uint64_t sequence, const repository::FaceKey&, const EncodedFace& face) {
        if (const auto sent = sendMessage(socket, DrawMessageKind::kFace, encodeNumberedFace(sequence, face)); !sent)
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
  // The terminal's Ctrl-C and a batch engine's SIGTERM reach the whole group, but the bake decides what is still drawn.
  ::signal(SIGINT, SIG_IGN);
  ::signal(SIGTERM, SIG_IGN);
  const auto drawn = serveBake(socket, encode);
  if (drawn) return 0;
  static_cast<void>(sendMessage(socket, DrawMessageKind::kError, encodeError(drawn.error())));
  return 1;
}

std::unique_ptr<FaceMaker> makeProcessFaceMaker(const FaceWork& work, const std::vector<std::string>& command,
                                                unsigned processes, FaceMaker::OnFace on_face,
                                                FaceMaker::OnError on_error) {
  return std::make_unique<ProcessFaceMaker>(work, command, processes, std::move(on_face), std::move(on_error));
}

unsigned drawProcessesFor(unsigned threads) {
  return std::clamp(threads, 1U, kMaxProcesses);
}

}  // namespace server
