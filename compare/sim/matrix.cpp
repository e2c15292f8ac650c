#include "compare/sim/matrix.h"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>

#include "base/egl/headless.h"
#include "base/file.h"
#include "base/format_text.h"
#include "base/json/camera_file.h"
#include "base/number.h"
#include "compare/run.h"
#include "compare/sim/page.h"
#include "compare/sim/published.h"
#include "server/net/open_scene.h"
#include "server/net/scene_names.h"

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

  Result<void> play(std::vector<PlayedRun>& runs) {
    LUMIGRID_ASSIGN_OR_RETURN(scene_, server::openScene(directory_));
    LUMIGRID_ASSIGN_OR_RETURN(const auto gl, base::HeadlessContext::create());
    LUMIGRID_ASSIGN_OR_RETURN(const auto painter, Painter::create(*scene_, *gl));
    const Truth truth(*scene_, options_.report + "/truth", options_.truth_supersampling);
    const auto methods = options_.methods.empty() ? possibleMethods() : options_.methods;
    std::unique_ptr<PublishedObjects> published;
    if (std::find(methods.begin(), methods.end(), "static") != methods.end()) {
      LUMIGRID_ASSIGN_OR_RETURN(published, PublishedObjects::create(*scene_, options_.report + "/published/" + name_));
    }
    const Stage stage{scene_.get(), painter.get(), published.get(), options_.costs, options_.play.seed};
    for (const MatrixPart& part : options_.parts) {
      LUMIGRID_ASSIGN_OR_RETURN(const auto paths, pathsOf(part));
      for (const NamedPath& path : paths)
        for (const LinkProfile& link : part.links)
          for (const std::string& method : methods)
            for (const double knob : knobsOf(method, part.sweep))
              LUMIGRID_TRY(playOnce(stage, {method, knob}, path, link, truth, runs));
    }
    return {};
  }

 private:
  /// All methods that the scene has data for.
  std::vector<std::string> possibleMethods() const {
    std::vector<std::string> possible;
    for (const std::string& method : methodNames()) {
      const bool wants_images = method == "lumigraph" || method == "static" || method == "paper";
      if (wants_images && scene_->data.images == nullptr) continue;
      if (method == "static" && scene_->directory.empty()) continue;
      if (method == "qsplat" && scene_->splat_bytes.bytes().empty()) continue;
      possible.push_back(method);
    }
    return possible;
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
      LUMIGRID_ASSIGN_OR_RETURN(auto path, server::makePath(name, scene_->scene, options_.path));
      paths.push_back({name, std::move(path)});
    }
    return paths;
  }

  /// Plays what no earlier part has played.
  Result<void> playOnce(const Stage& stage, const MethodSetting& setting, const NamedPath& path,
                        const LinkProfile& link, const Truth& truth, std::vector<PlayedRun>& runs) {
    for (const PlayedRun& run : runs)
      if (run.scene == name_ && run.setting.method == setting.method && run.setting.knob == setting.knob &&
          run.path == path.name && run.link == link.name)
        return {};
    LUMIGRID_ASSIGN_OR_RETURN(auto run, playOne(stage, setting, path, link, truth));
    runs.push_back(std::move(run));
    return {};
  }

  Result<PlayedRun> playOne(const Stage& stage, const MethodSetting& setting, const NamedPath& path,
                            const LinkProfile& link, const Truth& truth) {
    PlayOptions play = options_.play;
    std::string folder = name_ + "_" + setting.method + formatText("_%g_", setting.knob) + path.name + "_" + link.name;
    for (char& c : folder)
      if (c == '/' || c == '%') c = '-';
    if (options_.pictures) play.pictures = options_.report + "/frames/" + folder;
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
};

/// Empty for a time that was never reached.
std::string secondsText(double seconds) {
  return seconds < 0.0 ? "" : formatText("%.3f", seconds);
}

/// Empty where the last view does not show the model.
std::string restText(const PlayedRun& run) {
  const DisplayedFrame& last = run.frames.back();
  return last.kind == InstantKind::kRest ? formatText("%.3f", last.accuracy.psnr_db) : "";
}

std::string keyColumns(const PlayedRun& run) {
  return run.scene + "," + run.setting.method + "," + formatText("%g", run.setting.knob) + "," + run.path + "," +
         run.link;
}

std::string byteColumns(const PlayerCounts& c) {
  return formatText("%llu,%llu,%llu,%llu", static_cast<unsigned long long>(c.bytes),
                    static_cast<unsigned long long>(c.bytes_images), static_cast<unsigned long long>(c.bytes_patches),
                    static_cast<unsigned long long>(c.bytes_frames));
}

/// Null for an empty cell.
nlohmann::json numberOrText(const std::string& cell) {
  if (cell.empty()) return nullptr;
  const auto number = base::parseNumber(cell);
  return number ? nlohmann::json(*number) : nlohmann::json(cell);
}

/// The rows of a table as objects, by its columns.
nlohmann::json rowsOf(const std::string& csv) {
  std::istringstream in(csv);
  const auto cellsOf = [](const std::string& line) {
    std::vector<std::string> cells;
    std::istringstream rest(line + ",");
    for (std::string cell; std::getline(rest, cell, ',');) cells.push_back(cell);
    return cells;
  };
  std::string line;
  std::getline(in, line);
  const std::vector<std::string> columns = cellsOf(line);
  nlohmann::json rows = nlohmann::json::array();
  while (std::getline(in, line)) {
    const std::vector<std::string> cells = cellsOf(line);
    nlohmann::json row;
    for (std::size_t i = 0; i < columns.size(); ++i) row[columns[i]] = numberOrText(cells[i]);
    rows.push_back(std::move(row));
  }
  return rows;
}

/// The bytes of a scene on disk, part by part: "patch.lgp", "qsplat.lgq", "images".
nlohmann::json bytesOnDisk(const std::string& directory) {
  namespace fs = std::filesystem;
  nlohmann::json bytes = nlohmann::json::object();
  std::error_code ignored;  // a scene behind a network has no directory here
  fs::recursive_directory_iterator entry(directory, ignored);
  for (; entry != fs::recursive_directory_iterator(); entry.increment(ignored)) {
    if (!entry->is_regular_file(ignored)) continue;
    const std::string part = fs::relative(entry->path(), directory, ignored).begin()->string();
    bytes[part] = bytes.value(part, std::uint64_t{0}) + entry->file_size(ignored);
  }
  return bytes;
}

std::string resultsJson(const PageContext& c, const MatrixOptions& options, const std::vector<PlayedRun>& runs) {
  nlohmann::json scenes = nlohmann::json::array();
  for (const std::string& directory : options.scenes)
    scenes.push_back({{"scene", directory}, {"bytes_on_disk", bytesOnDisk(directory)}});
  const nlohmann::json results{{"version", 1},
                               {"command", c.command},
                               {"commit", c.commit},
                               {"machine", c.machine},
                               {"renderer", c.renderer},
                               {"parameters",
                                {{"width", options.path.width},
                                 {"height", options.path.height},
                                 {"seconds", options.path.seconds},
                                 {"instants", c.play.instants},
                                 {"seed", c.play.seed},
                                 {"display_hertz", c.play.display_hertz},
                                 {"rest_seconds", c.play.rest_seconds},
                                 {"truth_supersampling", options.truth_supersampling},
                                 {"server_render_ms", 1e3 * c.costs.server_render_seconds},
                                 {"decode_ms", 1e3 * c.costs.client_decode_seconds},
                                 {"draw_ms", 1e3 * c.costs.client_draw_seconds}}},
                               {"scenes", scenes},
                               {"runs", rowsOf(summaryCsv(runs))}};
  return results.dump(1) + "\n";
}

Result<void> writeFigures(const MatrixOptions& options, const std::vector<PlayedRun>& runs) {
  const auto write = [&](const char* name, const std::string& text) {
    return base::writeFileAtomically(options.report + name, base::viewOfText(text));
  };
  LUMIGRID_ASSIGN_OR_RETURN(const auto gl, base::HeadlessContext::create());
  const PageContext context{machineName(),   LUMIGRID_COMMIT, gl->renderer(),
                            options.command, options.play,    options.costs};
  LUMIGRID_TRY(write("/index.html", formatPage(context, runs)));
  LUMIGRID_TRY(write("/results.csv", resultsCsv(runs)));
  LUMIGRID_TRY(write("/results.json", resultsJson(context, options, runs)));
  return write("/summary.csv", summaryCsv(runs));
}

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

std::string resultsCsv(const std::vector<PlayedRun>& runs) {
  std::string out =
      "scene,method,knob,path,link,instant,seconds,bytes,bytes_images,bytes_patches,bytes_frames,requests,cache_bytes,"
      "triangles,images,age_s,at_rest,psnr_db,ssim,mean_abs,holes_share,excess_share,silhouette_px,silhouette_p95_px,"
      "flicker,foreground,draw_wall_ms\n";
  for (const PlayedRun& run : runs)
    for (const DisplayedFrame& f : run.frames) {
      const Accuracy& a = f.accuracy;
      out += keyColumns(run) + "," + nameOf(f.kind) + "," + formatText("%.3f,", f.seconds) + byteColumns(f.counts) +
             formatText(",%llu,%llu,%llu,%u,%.3f,%d", static_cast<unsigned long long>(f.counts.requests),
                        static_cast<unsigned long long>(f.counts.cache_bytes),
                        static_cast<unsigned long long>(f.counts.triangles), f.counts.images, f.counts.age_seconds,
                        f.at_rest ? 1 : 0) +
             formatText(",%.3f,%.5f,%.3f,%.5f,%.5f,%.3f,%.3f,%s,%llu,%.2f\n", a.psnr_db, a.ssim, a.mean_abs,
                        a.missing_share, a.excess_share, a.silhouette_px, a.silhouette_p95_px,
                        f.flicker ? formatText("%.3f", *f.flicker).c_str() : "",
                        static_cast<unsigned long long>(a.foreground), f.draw_wall_ms);
    }
  return out;
}

std::string summaryCsv(const std::vector<PlayedRun>& runs) {
  std::string out =
      "scene,method,knob,path,link,frames,bytes,bytes_images,bytes_patches,bytes_frames,mean_psnr_db,p5_psnr_db,"
      "mean_ssim,holes_share,silhouette_px,silhouette_p95_px,flicker,time_to_first_s,time_to_25_s,time_to_30_s,"
      "time_to_35_s,at_rest_psnr_db,rest_s,draw_wall_ms\n";
  for (const PlayedRun& run : runs) {
    double wall = 0.0;
    for (const DisplayedFrame& f : run.frames) wall += f.draw_wall_ms / static_cast<double>(run.frames.size());
    out += keyColumns(run) + "," + std::to_string(run.moving().size()) + "," + byteColumns(run.frames.back().counts) +
           formatText(",%.3f,%.3f,%.5f,%.5f,%.3f,%.3f,%.3f", run.meanPsnr(), run.p5Psnr(), run.meanSsim(),
                      run.meanMissing(), run.silhouette(), run.p95Silhouette(), run.meanFlicker()) +
           "," + secondsText(run.secondsToFirst()) + "," + secondsText(run.secondsTo(25.0)) + "," +
           secondsText(run.secondsTo(30.0)) + "," + secondsText(run.secondsTo(35.0)) + "," + restText(run) + "," +
           secondsText(run.rest_seconds) + formatText(",%.2f\n", wall);
  }
  return out;
}

Result<std::vector<PlayedRun>> playMatrix(const MatrixOptions& options,
                                          const std::function<void(const std::string&)>& log) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto names, server::sceneNames(options.scenes));
  LUMIGRID_TRY(base::makeDirectories(options.report));
  std::vector<PlayedRun> runs;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto played = SceneMatrix(options, options.scenes[i], names[i], log).play(runs);
    if (!played) return base::within(options.scenes[i], played.error());
    LUMIGRID_TRY(writeFigures(options, runs));  // so that an error in a later scene loses nothing
  }
  return runs;
}

}  // namespace compare
