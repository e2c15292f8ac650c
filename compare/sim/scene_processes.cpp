#include "compare/sim/scene_processes.h"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <utility>

#include "base/bytes.h"
#include "base/file.h"
#include "base/parallel.h"

namespace compare {
namespace {

using base::Result;

void writeFrame(const DisplayedFrame& frame, base::ByteWriter& out) {
  out.write(frame.kind);
  out.write(frame.seconds);
  out.write(frame.draw_wall_ms);
  out.write(frame.counts);
  out.write(frame.at_rest);
  out.write(frame.accuracy);
  out.write(frame.flicker.has_value());
  out.write(frame.flicker.value_or(Flicker{}));
  for (const base::Bytes* picture : {&frame.picture_jpeg, &frame.difference_jpeg}) {
    out.u32(static_cast<std::uint32_t>(picture->size()));
    out.bytes(*picture);
  }
}

DisplayedFrame readFrame(base::ByteReader& in) {
  DisplayedFrame frame;
  frame.kind = in.read<InstantKind>();
  frame.seconds = in.f64();
  frame.draw_wall_ms = in.f64();
  frame.counts = in.read<PlayerCounts>();
  frame.at_rest = in.read<bool>();
  frame.accuracy = in.read<Accuracy>();
  const bool flickers = in.read<bool>();
  const auto flicker = in.read<Flicker>();
  if (flickers) frame.flicker = flicker;
  for (base::Bytes* picture : {&frame.picture_jpeg, &frame.difference_jpeg}) {
    const base::ByteView bytes = in.bytes(in.u32());
    picture->assign(bytes.begin(), bytes.end());
  }
  return frame;
}

/// The processes of one call, and the files in which they leave what they played.
class SceneProcesses {
 public:
  SceneProcesses(unsigned jobs, const std::string& folder, const PlayScene& play)
      : jobs_(jobs), folder_(folder), play_(play) {}
  ~SceneProcesses() {
    for (const auto& [process, scene] : running_) ::kill(process, SIGKILL);
    for (const auto& [process, scene] : running_) {
      ::waitpid(process, nullptr, 0);
      removeFile(scene);
    }
  }
  SceneProcesses(const SceneProcesses&) = delete;
  SceneProcesses& operator=(const SceneProcesses&) = delete;

  std::size_t running() const { return running_.size(); }

  Result<void> start(std::size_t scene) {
    std::fflush(nullptr);  // what waits to be printed would be printed twice
    const pid_t process = ::fork();
    if (process < 0) return base::systemError("a scene", "start a process for it", errno);
    if (process == 0) {
      // Mesa's threads for painting only get in the way when there is a process for each core.
      if (jobs_ >= base::coreCount()) ::setenv("LP_NUM_THREADS", "0", 0);
      runChild(scene);
    }
    running_[process] = scene;
    return {};
  }

  /// Waits for one of them to end.
  Result<std::pair<std::size_t, PlayedScene>> wait() {
    int status = 0;
    const pid_t process = ::waitpid(-1, &status, 0);
    const auto found = running_.find(process);
    if (found == running_.end()) return base::systemError("a scene", "wait for its process", errno);
    const std::size_t scene = found->second;
    running_.erase(found);
    const auto bytes = base::readFile(fileOf(scene));
    removeFile(scene);
    if (!WIFEXITED(status))
      return died("was ended by signal " + std::to_string(WTERMSIG(status)) + "; --jobs 1 takes less memory");
    if (!bytes) return bytes.error();
    if (WEXITSTATUS(status) != 0) return base::Error{base::ErrorCode::kInvalidInput, {bytes->begin(), bytes->end()}};
    auto played = decodeScene(*bytes);
    if (!played) return died("left " + fileOf(scene) + " incomplete");
    return std::pair{scene, std::move(*played)};
  }

 private:
  static base::Error died(const std::string& how) {
    return {base::ErrorCode::kIo, "the process that played a scene " + how};
  }
  std::string fileOf(std::size_t scene) const { return folder_ + "/.runs-" + std::to_string(scene); }
  void removeFile(std::size_t scene) const {
    std::error_code ignored;
    std::filesystem::remove(fileOf(scene), ignored);
    base::removeUnfinished(fileOf(scene));
  }
  /// Exit status 0: the file holds the runs; 1: it holds an error's message.
  [[noreturn]] void runChild(std::size_t scene) const {
    const auto played = play_(scene);
    const base::Bytes bytes = played ? encodeScene(*played) : base::Bytes();
    const auto written = base::writeFileAtomically(
        fileOf(scene), played ? base::ByteView(bytes) : base::viewOfText(played.error().message));
    if (!written) std::fprintf(stderr, "lumigrid-compare: %s\n", written.error().message.c_str());
    std::fflush(nullptr);
    ::_exit(played && written ? 0 : 1);  // without the destructors of what the parent had made
  }

  const unsigned jobs_;
  const std::string& folder_;
  const PlayScene& play_;
  std::map<pid_t, std::size_t> running_;
};

}  // namespace

base::Bytes encodeScene(const PlayedScene& scene) {
  base::ByteWriter out;
  out.string16(scene.renderer);
  out.u32(static_cast<std::uint32_t>(scene.runs.size()));
  for (const PlayedRun& run : scene.runs) {
    for (const std::string* text : {&run.scene, &run.link, &run.path, &run.setting.method}) out.string16(*text);
    out.write(run.setting.knob);
    out.write(run.rest_seconds);
    out.write(run.late_share);
    out.u32(static_cast<std::uint32_t>(run.frames.size()));
    for (const DisplayedFrame& frame : run.frames) writeFrame(frame, out);
  }
  return out.takeBytes();
}

std::optional<PlayedScene> decodeScene(base::ByteView bytes) {
  base::ByteReader in(bytes);
  PlayedScene scene{in.string16(), {}};
  for (std::uint32_t left = in.u32(); left > 0 && in.ok(); --left) {
    PlayedRun run;
    for (std::string* text : {&run.scene, &run.link, &run.path, &run.setting.method}) *text = in.string16();
    run.setting.knob = in.f64();
    run.rest_seconds = in.f64();
    run.late_share = in.f64();
    for (std::uint32_t frames = in.u32(); frames > 0 && in.ok(); --frames) run.frames.push_back(readFrame(in));
    scene.runs.push_back(std::move(run));
  }
  if (!in.atEnd()) return std::nullopt;
  return scene;
}

Result<void> playInProcesses(std::size_t scenes, unsigned jobs, const std::string& folder, const PlayScene& play,
                             const SceneDone& done) {
  SceneProcesses processes(jobs, folder, play);
  for (std::size_t next = 0; next < scenes || processes.running() > 0;) {
    for (; next < scenes && processes.running() < jobs; ++next) LUMIGRID_TRY(processes.start(next));
    LUMIGRID_ASSIGN_OR_RETURN(auto played, processes.wait());
    LUMIGRID_TRY(done(played.first, std::move(played.second)));
  }
  return {};
}

}  // namespace compare
