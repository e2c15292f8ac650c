#include "server/cli/build_command/report.h"

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "server/cli/auto_choice.h"
#include "server/cli/console.h"
#include "server/cli/scene_images.h"
#include "server/cli/streamed/info.h"
#include "server/cli/tuned.h"

namespace server::cli {
namespace {

double perSecond(std::uint64_t count, double seconds) {
  return static_cast<double>(count) / std::max(seconds, 1e-9);
}

nlohmann::json hierarchyJson(const lod::patch::builder::HierarchySummary& h, std::uint64_t triangles) {
  nlohmann::json levels = nlohmann::json::array();
  for (const auto& level : h.levels)
    levels.push_back({{"triangles", level.triangles},
                      {"patches", level.patches},
                      {"max_error", level.max_error},
                      {"typical_error", level.typical_error}});
  return {{"seconds", h.seconds},
          {"cpu_seconds", h.cpu_seconds},
          {"bytes", h.bytes},
          {"triangles_per_second", perSecond(triangles, h.seconds)},
          {"triangles_per_cpu_second", perSecond(triangles, h.cpu_seconds)},
          {"levels", levels}};
}

nlohmann::json splatBuildJson(const lod::qsplat::builder::BuildSummary& q) {
  nlohmann::json j = splatsJson(q.header);
  j["added_leaves"] = q.added_leaves;
  j["seconds"] = q.seconds;
  j["cpu_seconds"] = q.cpu_seconds;
  j["leaves_per_cpu_second"] = perSecond(q.header.leaves, q.cpu_seconds);
  return j;
}

nlohmann::json umbrellaBuildJson(const lod::pmr::builder::BuildSummary& p) {
  nlohmann::json j = umbrellasJson(p.header, p.points, p.triangles);
  j["duplicates"] = p.duplicates;
  j["outliers"] = p.outliers;
  j["seconds"] = p.seconds;
  j["cpu_seconds"] = p.cpu_seconds;
  j["points_per_cpu_second"] = perSecond(p.header.points, p.cpu_seconds);
  return j;
}

nlohmann::json hlodBuildJson(const lod::hlod::builder::BuildSummary& h) {
  nlohmann::json j = hlodJson(h.header, h.levels);
  j["seconds"] = h.seconds;
  j["cpu_seconds"] = h.cpu_seconds;
  j["triangles_per_cpu_second"] = perSecond(h.header.source_triangles, h.cpu_seconds);
  return j;
}

/// The summary of the source by the first method that was built; null where none was.
const lod::ingest::SourceSummary* sourceSummary(const BuildReport& r) {
  if (r.hierarchy) return &*r.hierarchy;
  if (r.splats) return &*r.splats;
  if (r.umbrellas) return &*r.umbrellas;
  return r.hlod ? &*r.hlod : nullptr;
}

/// Whether any face is more than one image.
bool hasTiles(const BakeSummary& b) {
  return std::any_of(b.by_depth.begin() + 1, b.by_depth.end(), [](const TileCount& c) { return c.tiles > 0; });
}

nlohmann::json depthsJson(const BakeSummary& b) {
  nlohmann::json depths = nlohmann::json::array();
  for (const TileCount& count : b.by_depth) depths.push_back({{"tiles", count.tiles}, {"bytes", count.bytes}});
  return depths;
}

nlohmann::json imagesJson(const BakeSummary& b) {
  return {{"rendered", b.faces_rendered},
          {"skipped", b.faces_skipped},
          {"empty", b.faces_empty},
          {"jpeg_bytes", b.jpeg_bytes},
          {"coverage_bytes", b.coverage_bytes},
          {"depths", depthsJson(b)},
          {"seconds", b.seconds},
          {"images_per_second", perSecond(b.faces_rendered, b.seconds)}};
}

nlohmann::json reportJson(const base::Scene& scene, const BuildReport& r) {
  nlohmann::json j{
      {"triangles", scene.triangles},  {"repairs", scene.repairs},
      {"warnings", r.warnings},        {"peak_memory_bytes", peakResidentBytes()},
      {"complete", r.missing.empty()}, {"removed", {{"damaged", r.removed.damaged}, {"orphans", r.removed.orphans}}}};
  if (const auto* source = sourceSummary(r)) j["import_seconds"] = source->import_seconds;
  if (r.hierarchy) j["hierarchy"] = hierarchyJson(*r.hierarchy, scene.triangles);
  if (r.splats) j["qsplat"] = splatBuildJson(*r.splats);
  if (r.umbrellas) j["pmr"] = umbrellaBuildJson(*r.umbrellas);
  if (r.hlod) j["hlod"] = hlodBuildJson(*r.hlod);
  if (r.trial) j["auto"] = trialJson(*r.trial);
  if (r.tuned) j["tuned"] = tunedJson(*r.tuned);
  if (r.bake) j["images"] = imagesJson(*r.bake);
  return j;
}

// The last lines say what was put right in a finished scene, and what comes next.
void printOutcome(const BuildArguments& a, const BuildOutput& output, const BuildReport& r) {
  if (r.removed.damaged + r.removed.orphans > 0)
    std::printf("repaired: %s damaged images rendered again, %s removed that did not belong here\n",
                formatCount(r.removed.damaged).c_str(), formatCount(r.removed.orphans).c_str());
  else if (output.finished && sourceSummary(r) == nullptr && (!r.bake || r.bake->faces_rendered == 0))
    std::printf("%s: finished and whole; nothing was to be done\n", a.output.c_str());
  std::printf("peak memory %s\n", formatBytes(peakResidentBytes()).c_str());
  if (r.missing.empty())
    std::printf(
        hasPart(*output.scene, kPatches.file) ? "next: lumigrid serve %s\n" : "next: lumigrid publish %s DEST\n",
        a.output.c_str());
  else
    std::printf(
        "next: %zu more shards (%s) with the same command; lumigrid build --missing -o %s lists what they lack\n",
        r.missing.size(), arrayOf(r.missing).c_str(), a.output.c_str());
}

void printHierarchy(const lod::patch::builder::HierarchySummary& h, std::uint64_t triangles) {
  std::printf("hierarchy: %.0f triangles/s (%.0f per core), %s in %s\n", perSecond(triangles, h.seconds),
              perSecond(triangles, h.cpu_seconds), formatBytes(h.bytes).c_str(), formatSeconds(h.seconds).c_str());
  for (std::size_t level = 0; level < h.levels.size(); ++level)
    std::printf("  level %2zu: %12s triangles %8s patches, error typically %.3g, nowhere above %.3g\n", level,
                formatCount(h.levels[level].triangles).c_str(), formatCount(h.levels[level].patches).c_str(),
                h.levels[level].typical_error, static_cast<double>(h.levels[level].max_error));
}

void printSplats(const lod::qsplat::builder::BuildSummary& q) {
  std::printf("splats: %.0f leaves/s (%.0f per core) in %s; %s\n", perSecond(q.header.leaves, q.seconds),
              perSecond(q.header.leaves, q.cpu_seconds), formatSeconds(q.seconds).c_str(),
              describeSplats(splatsJson(q.header)).c_str());
}

void printUmbrellas(const lod::pmr::builder::BuildSummary& p) {
  std::printf("umbrellas: %.0f points/s (%.0f per core) in %s; %s duplicates left out, %s points without a triangle\n",
              perSecond(p.header.points, p.seconds), perSecond(p.header.points, p.cpu_seconds),
              formatSeconds(p.seconds).c_str(), formatCount(p.duplicates).c_str(), formatCount(p.outliers).c_str());
  std::printf("  %s\n", describeUmbrellas(umbrellasJson(p.header, p.points, p.triangles)).c_str());
}

void printHlod(const lod::hlod::builder::BuildSummary& h) {
  std::printf("octree: %.0f triangles/s (%.0f per core) in %s; %s\n", perSecond(h.header.source_triangles, h.seconds),
              perSecond(h.header.source_triangles, h.cpu_seconds), formatSeconds(h.seconds).c_str(),
              describeHlod(hlodJson(h.header, h.levels)).c_str());
}

/// The points of a scene that was made from points, where they were built; nothing for others.
std::optional<std::uint64_t> sourcePoints(const base::Scene& scene, const BuildReport& r) {
  if (scene.triangles != 0) return std::nullopt;
  if (r.splats) return r.splats->header.leaves - r.splats->added_leaves;
  if (r.umbrellas) return r.umbrellas->header.points;
  return std::nullopt;
}

void printImages(const BakeSummary& b) {
  std::printf("images: %.1f images/s; %s rendered (%s empty), %s were there already; %s pictures, %s coverage\n",
              perSecond(b.faces_rendered, b.seconds), formatCount(b.faces_rendered).c_str(),
              formatCount(b.faces_empty).c_str(), formatCount(b.faces_skipped).c_str(),
              formatBytes(b.jpeg_bytes).c_str(), formatBytes(b.coverage_bytes).c_str());
  if (!hasTiles(b)) return;
  for (std::size_t depth = 0; depth < b.by_depth.size() && b.by_depth[depth].tiles > 0; ++depth)
    std::printf("  depth %zu: %12s tiles %12s\n", depth, formatCount(b.by_depth[depth].tiles).c_str(),
                formatBytes(b.by_depth[depth].bytes).c_str());
}

void printText(const BuildArguments& a, const BuildOutput& output, const BuildReport& r) {
  const base::Scene& scene = *output.scene;
  const auto points = sourcePoints(scene, r);
  std::printf("%s: %s %s\n", a.output.c_str(), formatCount(points.value_or(scene.triangles)).c_str(),
              points ? "points" : "triangles");
  for (const auto& [repair, count] : scene.repairs)
    std::printf("  repaired: %s %s\n", formatCount(count).c_str(), repair.c_str());
  if (r.hierarchy) printHierarchy(*r.hierarchy, scene.triangles);
  if (r.splats) printSplats(*r.splats);
  if (r.umbrellas) printUmbrellas(*r.umbrellas);
  if (r.hlod) printHlod(*r.hlod);
  if (r.trial) std::printf("auto: %s\n", describeTrial(*r.trial).c_str());
  if (r.tuned) std::printf("tuned to %s dB: %s\n", a.tune.c_str(), describeChoice(*r.tuned).c_str());
  if (r.bake) printImages(*r.bake);
  printOutcome(a, output, r);
}

}  // namespace

void printReport(const BuildArguments& a, const BuildOutput& output, const BuildReport& report) {
  if (a.json)
    std::printf("%s\n", reportJson(*output.scene, report).dump().c_str());
  else
    printText(a, output, report);
}

}  // namespace server::cli
