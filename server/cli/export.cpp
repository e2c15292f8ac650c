// lumigrid export writes a scene in formats of other programs: its hierarchy as 3D Tiles, or one cut as a mesh.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "base/stopwatch.h"
#include "server/cli/commands.h"
#include "server/cli/console.h"
#include "server/export/cut_file.h"
#include "server/export/tileset.h"

namespace server::cli {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;
using nlohmann::json;

struct ExportArguments {
  std::string scene;
  std::string tiles, ply, glb;  // where to write; empty: not asked for
  std::uint64_t triangles = exports::kAllTriangles;
  int quality = 90;
  bool force = false, json = false, quiet = false;
};

struct WrittenMesh {
  std::string path;
  exports::CutFileReport report;
  float error = 0.0F;
};

struct ExportSummary {
  std::optional<exports::TilesetReport> tiles;
  std::vector<WrittenMesh> meshes;
  double seconds = 0.0;
};

Result<void> refuseExisting(const ExportArguments& a, const std::string& path) {
  std::error_code ignored;
  if (path.empty() || a.force || !std::filesystem::exists(path, ignored)) return {};
  return Error{ErrorCode::kExists, path + ": exists already; choose another name or say --force"};
}

Result<void> exportTiles(const ExportArguments& a, const exports::ExportScene& scene, ExportSummary& summary) {
  const base::Stopwatch watch;
  ProgressLine line(a.quiet);
  auto written = exports::writeTileset(scene, a.tiles, {.force = a.force}, [&](double done, std::uint64_t bytes) {
    line.show(
        "tiles", done,
        formatBytes(bytes) + ", " +
            formatBytes(static_cast<std::uint64_t>(static_cast<double>(bytes) / std::max(watch.seconds(), 1e-3))) +
            "/s");
    return !stopRequested();
  });
  line.finish();
  if (!written) return written.error();
  summary.tiles = *written;
  return {};
}

using WriteCut = Result<exports::CutFileReport>(const exports::ExportScene&, const lod::patch::Cut&, const std::string&,
                                                const exports::CutProgress&);

Result<void> exportMesh(const ExportArguments& a, const exports::ExportScene& scene, const exports::ExportCut& cut,
                        const std::string& path, WriteCut& write, ExportSummary& summary) {
  ProgressLine line(a.quiet);
  auto written = write(scene, cut.cut, path, [&](double done) {
    line.show(path, done);
    return !stopRequested();
  });
  line.finish();
  if (!written) return written.error();
  summary.meshes.push_back({path, *written, cut.error});
  return {};
}

Result<ExportSummary> run(const ExportArguments& a) {
  const base::Stopwatch watch;
  LUMIGRID_TRY(refuseExisting(a, a.ply));
  LUMIGRID_TRY(refuseExisting(a, a.glb));
  LUMIGRID_ASSIGN_OR_RETURN(auto scene, exports::openForExport(a.scene));
  scene.jpeg_quality = a.quality;
  ExportSummary summary;
  if (!a.ply.empty() || !a.glb.empty()) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto cut, exports::selectCutForExport(scene.hierarchy(), a.triangles));
    if (!a.ply.empty()) LUMIGRID_TRY(exportMesh(a, scene, cut, a.ply, exports::writeCutAsPly, summary));
    if (!a.glb.empty()) LUMIGRID_TRY(exportMesh(a, scene, cut, a.glb, exports::writeCutAsGlb, summary));
  }
  if (!a.tiles.empty()) LUMIGRID_TRY(exportTiles(a, scene, summary));
  summary.seconds = watch.seconds();
  return summary;
}

void printJson(const ExportArguments& a, const ExportSummary& s) {
  json j{{"scene", a.scene}, {"seconds", s.seconds}};
  if (s.tiles)
    j["3dtiles"] = {{"directory", a.tiles},
                    {"tiles", s.tiles->tiles},
                    {"documents", s.tiles->documents},
                    {"triangles", s.tiles->triangles},
                    {"bytes", s.tiles->bytes}};
  for (const WrittenMesh& mesh : s.meshes)
    j["meshes"].push_back({{"path", mesh.path},
                           {"vertices", mesh.report.vertices},
                           {"triangles", mesh.report.triangles},
                           {"bytes", mesh.report.bytes},
                           {"error", mesh.error}});
  std::printf("%s\n", j.dump(2).c_str());
}

void print(const ExportArguments& a, const ExportSummary& s) {
  for (const WrittenMesh& mesh : s.meshes)
    std::printf("%s: %s triangles, %s vertices, %s; error %g\n", mesh.path.c_str(),
                formatCount(mesh.report.triangles).c_str(), formatCount(mesh.report.vertices).c_str(),
                formatBytes(mesh.report.bytes).c_str(), static_cast<double>(mesh.error));
  if (s.tiles)
    std::printf("%s/tileset.json: %s tiles of %s triangles, %s, in %s\n", a.tiles.c_str(),
                formatCount(s.tiles->tiles).c_str(), formatCount(s.tiles->triangles).c_str(),
                formatBytes(s.tiles->bytes).c_str(), formatSeconds(s.seconds).c_str());
}

/// A combination of options that parsing them one by one cannot refuse; empty where there is none.
std::string wrongUsage(const ExportArguments& a) {
  const bool mesh = !a.ply.empty() || !a.glb.empty();
  if (a.tiles.empty() && !mesh) return "say what to write: --3dtiles DIR, --ply FILE or --glb FILE";
  if (a.triangles != exports::kAllTriangles && !mesh)
    return "--triangles is for --ply and --glb; 3D Tiles have every level";
  return {};
}

}  // namespace

RunCommand addExport(CLI::App& command) {
  auto a = std::make_shared<ExportArguments>();
  command.add_option("SCENE", a->scene, "scene directory, built or published")->required();
  command.add_option("--3dtiles", a->tiles,
                     "write the whole hierarchy as 3D Tiles 1.1 into this directory: tileset.json and GLB files, for "
                     "CesiumJS, 3DTilesRendererJS and others. Without cracks at any error once all is loaded; an "
                     "error of 1 pixel shows the scene as our viewers do. In the scene's own coordinates");
  command.add_option("--ply", a->ply, "write one mesh as binary PLY: survey coordinates as doubles, colours");
  command.add_option("--glb", a->glb,
                     "write one mesh as GLB: metres around the scene's origin, y up, with textures where there are "
                     "leaves; memory for the whole file");
  command
      .add_option("--triangles", a->triangles,
                  "most triangles of --ply and --glb: refined where the error is largest. Default: all, the leaves")
      ->transform(CLI::AsSizeValue(true))
      ->check(CLI::Range(std::uint64_t{1}, exports::kAllTriangles))
      ->default_str("");
  command.add_option("--quality", a->quality, "of the JPEGs that textures are written as, 1 to 100")
      ->check(CLI::Range(1, 100));
  command.add_flag("--force", a->force, "replace what is there: a file, or the files of an earlier export in DIR");
  command.add_flag("--json", a->json, "summary as JSON");
  command.add_flag("--quiet", a->quiet, "no progress and no summary");
  return [a]() -> int {
    if (const std::string problem = wrongUsage(*a); !problem.empty()) {
      fail({ErrorCode::kInvalidInput, problem});
      return kWrongUsage;
    }
    stopOnSignals();
    const auto summary = run(*a);
    if (!summary) return fail(summary.error());
    if (a->json)
      printJson(*a, *summary);
    else if (!a->quiet)
      print(*a, *summary);
    return kDone;
  };
}

}  // namespace server::cli
