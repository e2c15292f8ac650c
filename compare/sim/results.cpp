#include "compare/sim/results.h"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/file.h"
#include "base/format_text.h"
#include "base/number.h"
#include "compare/csv.h"
#include "compare/run.h"
#include "compare/sim/page.h"
#include "server/net/scene_names.h"

namespace compare {

using base::formatText;

namespace {

/// Empty for a time that was never reached, and for a share that is not known.
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
  nlohmann::json rows = nlohmann::json::array();
  const auto table = parseCsv(csv).value_or(CsvTable());
  for (const auto& cells : table.rows) {
    nlohmann::json row;
    for (const auto& [column, cell] : cells) row[column] = numberOrText(cell);
    rows.push_back(std::move(row));
  }
  return rows;
}

/// The bytes of a file, or of all files below a folder.
std::uint64_t bytesOf(const std::filesystem::path& path) {
  namespace fs = std::filesystem;
  std::error_code ignored;
  if (!fs::is_directory(path, ignored)) return fs::file_size(path, ignored);
  std::uint64_t bytes = 0;
  for (fs::recursive_directory_iterator entry(path, ignored), end; entry != end; entry.increment(ignored))
    if (entry->is_regular_file(ignored)) bytes += entry->file_size(ignored);
  return bytes;
}

/// A scene's bytes on disk, and its times of SCENE/build.json (docs/formats/scene.md), which a published one lacks. One
/// behind a network has no directory here.
SceneCosts sceneCosts(const std::string& name, const std::string& directory) {
  namespace fs = std::filesystem;
  SceneCosts costs{name, {}, 0.0};
  const auto text = base::readFile(directory + "/build.json");
  const auto record = text ? nlohmann::json::parse(*text, nullptr, false) : nlohmann::json();
  const auto number = [&](const std::string& place, double otherwise) {
    const nlohmann::json::json_pointer pointer(place);
    return record.contains(pointer) && record[pointer].is_number() ? record[pointer].get<double>() : otherwise;
  };
  costs.peak_memory_bytes = number("/peak_memory_bytes", 0.0);
  std::error_code ignored;
  for (fs::directory_iterator entry(directory, ignored), end; entry != end; entry.increment(ignored)) {
    const std::string part = entry->path().filename().string();
    const std::string method = entry->path().stem().string();
    if (part != "build.json")
      costs.parts.push_back({part, bytesOf(entry->path()), number("/" + method + "/seconds", -1.0)});
  }
  std::sort(costs.parts.begin(), costs.parts.end(), [](const auto& a, const auto& b) { return a.name < b.name; });
  return costs;
}

nlohmann::json toJson(const SceneCosts& costs, const std::string& directory) {
  nlohmann::json bytes = nlohmann::json::object(), seconds = nlohmann::json::object();
  for (const PartCosts& part : costs.parts) {
    bytes[part.name] = part.bytes;
    if (part.build_seconds >= 0.0) seconds[part.name] = part.build_seconds;
  }
  return {{"scene", directory},
          {"bytes_on_disk", bytes},
          {"build_wall_seconds", seconds},
          {"build_peak_memory_bytes", costs.peak_memory_bytes}};
}

std::string resultsJson(const PageContext& c, const MatrixOptions& options, const std::vector<PlayedRun>& runs) {
  nlohmann::json scenes = nlohmann::json::array();
  for (std::size_t i = 0; i < c.scenes.size(); ++i) scenes.push_back(toJson(c.scenes[i], options.scenes[i]));
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

}  // namespace

std::string resultsCsv(const std::vector<PlayedRun>& runs) {
  std::string out =
      "scene,method,knob,path,link,instant,seconds,bytes,bytes_images,bytes_patches,bytes_frames,requests,cache_bytes,"
      "triangles,images,age_s,at_rest,psnr_db,ssim,mean_abs,holes_share,excess_share,silhouette_px,silhouette_p95_px,"
      "flicker,flicker_share,foreground,draw_wall_ms\n";
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
                        f.flicker ? formatText("%.3f,%.5f", f.flicker->mean, f.flicker->share).c_str() : ",",
                        static_cast<unsigned long long>(a.foreground), f.draw_wall_ms);
    }
  return out;
}

std::string summaryCsv(const std::vector<PlayedRun>& runs) {
  std::string out =
      "scene,method,knob,path,link,frames,bytes,bytes_images,bytes_patches,bytes_frames,mean_psnr_db,p5_psnr_db,"
      "mean_ssim,holes_share,silhouette_px,silhouette_p95_px,flicker,flicker_share,time_to_first_s,time_to_25_s,"
      "time_to_30_s,time_to_35_s,at_rest_psnr_db,rest_s,late_share,draw_wall_ms\n";
  for (const PlayedRun& run : runs) {
    const Flicker flicker = run.meanFlicker();
    double wall = 0.0;
    for (const DisplayedFrame& f : run.frames) wall += f.draw_wall_ms / static_cast<double>(run.frames.size());
    out += keyColumns(run) + "," + std::to_string(run.moving().size()) + "," + byteColumns(run.frames.back().counts) +
           formatText(",%.3f,%.3f,%.5f,%.5f,%.3f,%.3f,%.3f,%.5f", run.meanPsnr(), run.p5Psnr(), run.meanSsim(),
                      run.meanMissing(), run.silhouette(), run.p95Silhouette(), flicker.mean, flicker.share) +
           "," + secondsText(run.secondsToFirst()) + "," + secondsText(run.secondsTo(25.0)) + "," +
           secondsText(run.secondsTo(30.0)) + "," + secondsText(run.secondsTo(35.0)) + "," + restText(run) + "," +
           secondsText(run.rest_seconds) + "," + secondsText(run.late_share) + formatText(",%.2f\n", wall);
  }
  return out;
}

base::Result<void> writeResults(const MatrixOptions& options, const std::string& renderer,
                                const std::vector<PlayedRun>& runs) {
  const auto write = [&](const std::string& name, const std::string& text) {
    return base::writeFileAtomically(options.report + name, base::viewOfText(text));
  };
  LUMIGRID_ASSIGN_OR_RETURN(const auto names, server::sceneNames(options.scenes));
  PageContext context{machineName(), LUMIGRID_COMMIT, renderer, options.command, options.play, options.costs, {}};
  for (std::size_t i = 0; i < names.size(); ++i) context.scenes.push_back(sceneCosts(names[i], options.scenes[i]));
  LUMIGRID_TRY(write("/index.html", formatPage(context, runs)));
  LUMIGRID_TRY(base::makeDirectories(options.report + "/charts"));
  for (const ChartFile& chart : chartFiles(runs)) LUMIGRID_TRY(write("/charts/" + chart.name, chart.svg));
  LUMIGRID_TRY(write("/results.csv", resultsCsv(runs)));
  LUMIGRID_TRY(write("/results.json", resultsJson(context, options, runs)));
  return write("/summary.csv", summaryCsv(runs));
}

}  // namespace compare
