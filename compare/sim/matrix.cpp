#include "compare/sim/matrix.h"

#include <algorithm>
#include <filesystem>
#include <map>
#include <optional>
#include <utility>

#include "base/egl/headless.h"
#include "base/file.h"
#include "base/format_text.h"
#include "base/json/camera_file.h"
#include "compare/sim/published.h"
#include "compare/sim/results.h"
#include "compare/sim/scene_processes.h"
#include "server/net/scene_names.h"
#include "server/scene/open_scene.h"

namespace compare {
namespace {

using base::formatText;
using base::Result;

/// One scene, opened once for all its runs.
class SceneMatrix {
 public:
  SceneMatrix(const MatrixOptions& options, const std::string& directory, const std::string& name,
              const std::function<void(const std::string&)>& log)
      : options_(options), directory_(directory), name_(name), log_(log) {}

  Result<PlayedScene> play() {
    LUMIGRID_ASSIGN_OR_RETURN(scene_, server::openScene(directory_));
    if (scene_->data.patches != nullptr) {
      LUMIGRID_ASSIGN_OR_RETURN(rooms_, server::Indoors::ofScene(scene_->scene, scene_->patches));
    }
    LUMIGRID_ASSIGN_OR_RETURN(const auto gl, base::HeadlessContext::create());
    LUMIGRID_ASSIGN_OR_RETURN(const auto painter, Painter::create(*scene_, *gl));
    const Stage stage{scene_.get(),   painter.get(),      [this] { return published(); },
                      options_.costs, options_.play.seed, options_.idle_bytes};
    LUMIGRID_ASSIGN_OR_RETURN(const auto jobs,
                              jobsOf(options_.methods.empty() ? methodsFor(*scene_) : options_.methods));
    PlayedScene played{gl->renderer(), {}};
    std::map<lod::hlod::Shadows, Truth> truths;
    for (const Job& job : jobs) {
      const lod::hlod::Shadows shadows = shadowsOf(job.setting.method);
      const auto [truth, is_new] =
          truths.try_emplace(shadows, *scene_, options_.report + "/truth", options_.truth_supersampling, shadows);
      LUMIGRID_TRY(playOnce(stage, job, truth->second, played.runs));
    }
    return played;
  }

 private:
  struct Job {
    NamedPath path;
    LinkProfile link;
    MethodSetting setting;
  };

  /// All parts' runs, those of one path after the other, since they share the path's pictures.
  Result<std::vector<Job>> jobsOf(const std::vector<std::string>& methods) const {
    std::vector<Job> jobs;
    std::vector<std::string> order;
    for (const MatrixPart& part : options_.parts) {
      LUMIGRID_ASSIGN_OR_RETURN(const auto paths, pathsOf(part));
      for (const NamedPath& path : paths) {
        if (std::find(order.begin(), order.end(), path.name) == order.end()) order.push_back(path.name);
        for (const LinkProfile& link : part.links)
          for (const std::string& method : methods)
            for (const double knob : knobsOf(method, part.sweep)) jobs.push_back({path, link, {method, knob}});
      }
    }
    const auto place = [&](const Job& job) { return std::find(order.begin(), order.end(), job.path.name); };
    std::stable_sort(jobs.begin(), jobs.end(), [&](const Job& a, const Job& b) { return place(a) < place(b); });
    return jobs;
  }

  Result<const PublishedObjects*> published() {
    if (!published_) {
      LUMIGRID_ASSIGN_OR_RETURN(published_, PublishedObjects::create(*scene_, options_.report + "/published/" + name_));
    }
    return published_.get();
  }

  Result<std::vector<NamedPath>> pathsOf(const MatrixPart& part) const {
    std::vector<NamedPath> paths;
    for (const std::string& file : options_.path_files) {
      LUMIGRID_ASSIGN_OR_RETURN(auto path, base::readCameraPath(file));
      if (path.frames_per_second == 0.0) {
        path.frames_per_second = 1.0 / options_.stop_seconds;
        path.jumps = true;
      }
      paths.push_back({std::filesystem::path(file).stem().string(), std::move(path)});
    }
    if (!paths.empty()) return paths;
    for (const std::string& name : part.paths) {
      LUMIGRID_ASSIGN_OR_RETURN(auto path,
                                server::makePath(name, scene_->scene, options_.path, rooms_ ? &*rooms_ : nullptr));
      paths.push_back({name, std::move(path)});
    }
    return paths;
  }

  /// Plays what was not played yet: several parts may ask for the same.
  Result<void> playOnce(const Stage& stage, const Job& job, const Truth& truth, std::vector<PlayedRun>& runs) {
    for (const PlayedRun& run : runs)
      if (run.scene == name_ && run.setting.method == job.setting.method && run.setting.knob == job.setting.knob &&
          run.path == job.path.name && run.link == job.link.name)
        return {};
    LUMIGRID_ASSIGN_OR_RETURN(auto run, playOne(stage, job, truth));
    runs.push_back(std::move(run));
    return {};
  }

  Result<PlayedRun> playOne(const Stage& stage, const Job& job, const Truth& truth) {
    const auto& [path, link, setting] = job;
    PlayOptions play = options_.play;
    if (options_.pictures)
      play.pictures = options_.report + "/frames/" +
                      fileNameOf({name_, setting.method, formatText("%g", setting.knob), path.name, link.name});
    auto run = playPath(stage, setting, path, link, truth, play);
    if (!run) return base::within(setting.method + " along " + path.name, run.error());
    run->scene = name_;
    const PlayerCounts& counts = run->frames.back().counts;
    log_(formatText("%-12s %-10s %-5g %-14s %-18s %7.2f MB  %6.2f dB moving  %6.2f dB at rest", name_.c_str(),
                    setting.method.c_str(), setting.knob, path.name.c_str(), link.name.c_str(),
                    static_cast<double>(counts.bytes) / 1e6, run->meanPsnr(), run->frames.back().accuracy.psnr_db));
    return run;
  }

  const MatrixOptions& options_;
  const std::string& directory_;
  const std::string& name_;
  const std::function<void(const std::string&)>& log_;
  std::unique_ptr<server::OpenScene> scene_;
  std::optional<server::Indoors> rooms_;  ///< of an interior, whose paths lead through them
  std::unique_ptr<PublishedObjects> published_;
};

LinkProfile linkOf(const char* text) {
  return parseLink(text).value();
}

}  // namespace

std::vector<MatrixPart> matrixParts(const std::string& preset) {
  const LinkProfile phone = linkOf("384kbit/100ms"), home = linkOf("20Mbit/40ms");
  if (preset == "quick") return {{{"orbit-fast", "teleports"}, {phone, home}}};
  if (preset == "full")
    return {{server::pathNames(), {home}},
            {{"orbit-fast", "teleports"}, {phone, linkOf("5Mbit/60ms/20ms/1%"), linkOf("1Gbit/1ms"), linkOf("train")}},
            {{"orbit-fast"}, {home}, true}};
  return {{{"orbit"}, {home}}};
}

Result<std::vector<PlayedRun>> playMatrix(const MatrixOptions& options,
                                          const std::function<void(const std::string&)>& log) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto names, server::sceneNames(options.scenes));
  LUMIGRID_TRY(base::makeDirectories(options.report));
  const PlayScene play = [&](std::size_t i) -> Result<PlayedScene> {
    auto played = SceneMatrix(options, options.scenes[i], names[i], log).play();
    return played ? std::move(played) : base::within(options.scenes[i], played.error());
  };
  std::map<std::size_t, PlayedScene> scenes;
  std::vector<PlayedRun> runs;
  const SceneDone done = [&](std::size_t i, PlayedScene played) -> Result<void> {
    scenes[i] = std::move(played);
    runs.clear();
    for (const auto& [number, scene] : scenes) runs.insert(runs.end(), scene.runs.begin(), scene.runs.end());
    return writeResults(options, scenes.begin()->second.renderer, runs);  // so that an error later loses nothing
  };
  if (options.jobs > 1 && names.size() > 1)
    LUMIGRID_TRY(playInProcesses(names.size(), options.jobs, options.report, play, done));
  else
    for (std::size_t i = 0; i < names.size(); ++i) {
      LUMIGRID_ASSIGN_OR_RETURN(auto played, play(i));
      LUMIGRID_TRY(done(i, std::move(played)));
    }
  return runs;
}

}  // namespace compare
