// lumigrid build: import, hierarchy, repository, one after the other, each resumable.
//
// A build in progress keeps scene.json's document as building.json. What is finished is listed in its parts; a rerun
// with the same sources and options goes on from there. scene.json appears when everything is in place.
#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/crc32c.h"
#include "base/json/scene_file.h"
#include "lod/build/hierarchy_build.h"
#include "lod/patch/format.h"
#include "repository/grid.h"
#include "repository/store.h"
#include "server/bake/bake.h"
#include "server/cmd/commands.h"
#include "server/cmd/console.h"
#include "server/cmd/tuned.h"

namespace server::cmd {
namespace {

namespace fs = std::filesystem;
using base::Error;
using base::ErrorCode;
using base::Result;

struct BuildArguments {
  std::vector<std::string> meshes;
  std::string output;
  std::vector<std::string> methods{"patch", "images"};
  bool force = false, json = false, quiet = false;
  std::string light = "auto", up = "auto", units = "unknown", subsampling = "420", tune = "off";
  std::optional<double> tune_db;  ///< --tune in dB, nothing: off
  std::uint32_t grid = 32, face = 512;
  double margin = 0.5;
  std::string tmpdir, regroup = "on";
  lod::build::HierarchyOptions hierarchy;
  BakeOptions bake;
};

// Work files of the hierarchy, within the scene unless --tmpdir says otherwise.
constexpr const char* kWorkFiles = "patch.lgp.work";
constexpr const char* kWrittenWhole[] = {"patch.lgp", "scene.json", base::kBuildingFile};

/// What the summary tells.
struct BuildReport {
  std::optional<lod::build::HierarchySummary> hierarchy;  ///< absent when a resumed build had it already
  std::optional<TuneChoice> tuned;
  std::optional<BakeSummary> bake;
};

bool wants(const BuildArguments& a, const char* method) {
  return std::find(a.methods.begin(), a.methods.end(), method) != a.methods.end();
}

// The options that decide what the scene holds, as scene.json keeps them. Threads, batches and messages are not among
// them.
std::map<std::string, std::string> parametersOf(const BuildArguments& a) {
  auto number = [](auto v) { return nlohmann::json(v).dump(); };
  std::string methods;
  for (const char* method : {"patch", "images"})
    if (wants(a, method)) methods += (methods.empty() ? "" : ",") + std::string(method);
  return {{"methods", methods},
          {"grid", number(a.grid)},
          {"face", number(a.face)},
          {"margin", number(a.margin)},
          {"light", a.light},
          {"up", a.up},
          {"units", a.units},
          {a.tune_db ? "tune" : "quality", a.tune_db ? number(*a.tune_db) : number(a.bake.quality)},
          {"subsampling", a.tune_db ? "tuned" : a.subsampling},
          {"target", number(a.bake.target_db)},
          {"gain", number(a.bake.least_gain_db)},
          {"coarse-cells", number(a.bake.coarse_cells)},
          {"tolerance", number(a.bake.tolerance_px)},
          {"supersampling", number(a.bake.supersampling)},
          {"voxel-triangles", number(a.hierarchy.voxel_triangles)},
          {"leaf-triangles", number(a.hierarchy.leaf_triangles)},
          {"node-triangles", number(a.hierarchy.node_triangles)},
          {"position-bits", number(a.hierarchy.position_bits)},
          {"regroup", a.regroup}};
}

Result<std::vector<base::SceneSource>> describeSources(const BuildArguments& a) {
  std::vector<base::SceneSource> sources;
  for (const std::string& path : a.meshes) {
    auto hash = base::sha256OfFile(path);
    if (!hash) return hash.error();
    std::error_code ignored;
    sources.push_back({path, fs::file_size(path, ignored), *hash});
  }
  return sources;
}

bool sameSources(const std::vector<base::SceneSource>& a, const std::vector<base::SceneSource>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const auto& x, const auto& y) { return x.sha256 == y.sha256 && x.bytes == y.bytes; });
}

// Removes what a scene consists of, and nothing else that may lie in the directory.
Result<void> clear(const std::string& directory) {
  for (const char* name :
       {"scene.json", base::kBuildingFile, "patch.lgp", kWorkFiles, "images", "access.lga", "access.lga.lock"}) {
    std::error_code error;
    fs::remove_all(fs::path(directory) / name, error);
    if (error) return Error{ErrorCode::kIo, directory + "/" + name + ": cannot remove: " + error.message()};
  }
  return {};
}

// A file that was being written when its writer was killed.
bool isUnfinished(const std::string& name) {
  return std::any_of(std::begin(kWrittenWhole), std::end(kWrittenWhole),
                     [&](const char* whole) { return base::isUnfinished(name, whole); });
}

/// The unfinished build to go on with, or nothing for a fresh start; an error when the output may not be touched.
Result<std::optional<base::Scene>> openOutput(const BuildArguments& a, const std::vector<base::SceneSource>& sources) {
  std::optional<base::Scene> resumed;
  if (a.force || !fs::exists(a.output)) return resumed;
  if (!fs::is_directory(a.output))
    return Error{ErrorCode::kExists, a.output + ": is a file, not a scene directory; choose another output"};
  if (fs::exists(fs::path(a.output) / "scene.json"))
    return Error{
        ErrorCode::kExists,
        a.output + ": holds a finished scene already; choose another output, or say --force to build it again"};
  const std::string building = a.output + "/" + base::kBuildingFile;
  if (fs::exists(building)) {
    auto scene = base::readSceneFile(building);
    if (!scene) return scene.error();
    const bool has_images = fs::exists(fs::path(a.output) / "images" / "data.mdb");
    if (!takeOver(parametersOf(a), has_images, scene->parameters) || !sameSources(scene->sources, sources))
      return Error{
          ErrorCode::kExists,
          a.output +
              ": holds an unfinished build of other meshes or options; repeat those, or say --force to start afresh"};
    resumed = std::move(*scene);
    return resumed;
  }
  // A hierarchy that was stopped on the way has left its work files, or a patch.lgp that nothing lists yet.
  const bool only_work = std::all_of(fs::directory_iterator(a.output), fs::directory_iterator(), [](const auto& entry) {
    const std::string name = entry.path().filename().string();
    return name == kWorkFiles || name == "patch.lgp" || isUnfinished(name);
  });
  if (!only_work)
    return Error{ErrorCode::kExists,
                 a.output + ": is not empty and not a scene; choose another output, or say --force"};
  return resumed;
}

// Up, when not told: glTF says +y. A flat open scan stands on its shortest axis, on the side its surface faces;
// anything else is taken for a model with +y up, as scanners of objects write them.
glm::dvec3 guessUp(const lod::build::HierarchySummary& built, const BuildArguments& a) {
  if (a.up != "auto") return {a.up == "x" ? 1 : 0, a.up == "y" ? 1 : 0, a.up == "z" ? 1 : 0};
  const glm::dvec3 size = built.box_max - built.box_min;
  const int flat = size.x <= size.y && size.x <= size.z ? 0 : size.y <= size.z ? 1 : 2;
  const double second = std::min(size[(flat + 1) % 3], size[(flat + 2) % 3]);
  if (size[flat] > 0.5 * second) return {0, 1, 0};
  glm::dvec3 up(0.0);
  up[flat] = built.facing[flat] < 0.0 ? -1.0 : 1.0;
  return up;
}

base::Light chooseLight(const BuildArguments& a, bool has_colors, const glm::dvec3& up) {
  base::Light light;
  const bool unlit = a.light == "unlit" || (a.light == "auto" && has_colors);
  light.mode = unlit ? base::LightMode::kUnlit : base::LightMode::kSoft;
  // From above and a little from the side, whichever way up is.
  const glm::vec3 z = glm::vec3(glm::normalize(up));
  const glm::vec3 side = glm::normalize(glm::cross(z, std::abs(z.x) < 0.9F ? glm::vec3(1, 0, 0) : glm::vec3(0, 1, 0)));
  light.direction = glm::normalize(0.8F * z + 0.45F * side + 0.35F * glm::cross(side, z));
  return light;
}

void describeMesh(const lod::build::HierarchySummary& built, const BuildArguments& a, base::Scene& scene) {
  scene.origin = built.origin;
  scene.box_min = built.box_min;
  scene.box_max = built.box_max;
  scene.units = a.units;
  scene.up = guessUp(built, a);
  scene.has_colors = built.has_colors;
  scene.light = chooseLight(a, scene.has_colors, scene.up);
  scene.triangles = built.triangles;
  scene.repairs = built.repairs.counts;
}

Result<void> addPart(base::Scene& scene, const std::string& directory, const std::string& file) {
  const std::string path = directory + "/" + file;
  base::ScenePart part{file, 0, ""};
  if (!fs::is_directory(path)) {
    auto hash = base::sha256OfFile(path);
    if (!hash) return hash.error();
    part.bytes = fs::file_size(path);
    part.sha256 = *hash;
  }
  scene.parts.push_back(part);
  return base::writeSceneFile(scene, directory + "/" + base::kBuildingFile);
}

bool hasPart(const base::Scene& scene, const std::string& file) {
  return std::any_of(scene.parts.begin(), scene.parts.end(),
                     [&](const base::ScenePart& part) { return part.file == file; });
}

// One place for each output, so that several builds can share a directory.
std::string workDirectory(const BuildArguments& a) {
  if (a.tmpdir.empty()) return a.output + "/" + kWorkFiles;
  const std::string output = fs::absolute(a.output).lexically_normal().string();
  std::array<char, 16> name{};
  std::snprintf(name.data(), name.size(), "%08x",
                base::crc32c({reinterpret_cast<const std::uint8_t*>(output.data()), output.size()}));
  return a.tmpdir + "/lumigrid-" + name.data();
}

// What decides the hierarchy besides its own options.
std::string resumeKey(const std::vector<base::SceneSource>& sources) {
  std::string key;
  for (const base::SceneSource& source : sources) key += source.sha256 + " ";
  return key;
}

/// The hierarchy, from the files. What was found wrong with the meshes leaves nothing behind; what can go on later
/// leaves its work files.
Result<base::Scene> buildPatches(const BuildArguments& a, const std::vector<base::SceneSource>& sources,
                                 BuildReport& report, ProgressLine& line) {
  const bool fresh = !fs::exists(a.output);
  std::error_code error;
  fs::create_directories(a.output, error);
  if (error) return Error{ErrorCode::kIo, a.output + ": cannot make this directory: " + error.message()};
  if (a.force) LUMIGRID_TRY(clear(a.output));

  lod::build::HierarchyOptions options = a.hierarchy;
  options.regroup = a.regroup == "on";
  options.work_directory = workDirectory(a);
  options.resume_key = resumeKey(sources);
  options.on_plan = [&](const lod::build::BuildPlan& plan) {
    if (a.quiet) return;
    line.finish();
    std::fprintf(stderr, "%s triangles: about %s in the scene, up to %s of work files, about %s\n",
                 formatCount(plan.triangles).c_str(), formatBytes(plan.output_bytes).c_str(),
                 formatBytes(plan.work_bytes).c_str(), formatSeconds(plan.seconds).c_str());
  };
  auto summary = lod::build::buildHierarchyFromFiles(a.meshes, options, a.output + "/patch.lgp",
                                                     [&](const std::string& stage, double done) {
                                                       line.show("hierarchy: " + stage, done);
                                                       return !stopRequested();
                                                     });
  line.finish();
  if (!summary) {
    if (fresh) fs::remove(a.output, error);  // only when empty: nothing half-written stays
    return summary.error();
  }
  for (const std::string& warning : summary->warnings) std::fprintf(stderr, "lumigrid: warning: %s\n", warning.c_str());
  base::Scene scene;
  scene.sources = sources;
  scene.parameters = parametersOf(a);
  describeMesh(*summary, a, scene);
  report.hierarchy = std::move(*summary);
  LUMIGRID_TRY(addPart(scene, a.output, "patch.lgp"));
  return scene;
}

repository::Subsampling subsamplingOf(const std::string& name) {
  return name == "444"   ? repository::Subsampling::k444
         : name == "422" ? repository::Subsampling::k422
                         : repository::Subsampling::k420;
}

/// With --tune: the choice that an earlier run kept, or a new one, which is kept before the first image.
Result<void> chooseQuality(const BuildArguments& a, const lod::patch::PatchFile& patches, base::Scene& scene,
                           BuildReport& report, BakeOptions& options) {
  if (!a.tune_db) return {};
  auto choice = storedChoice(scene.parameters);
  if (!choice) return base::within(a.output + "/" + base::kBuildingFile, choice.error());
  if (!*choice) {
    auto tuned = tuneScene(scene, patches, options, *a.tune_db);
    if (!tuned) return base::within("--tune", tuned.error());
    *choice = *tuned;
    storeChoice(**choice, scene.parameters);
    LUMIGRID_TRY(base::writeSceneFile(scene, a.output + "/" + base::kBuildingFile));
  }
  report.tuned = **choice;
  options.quality = (*choice)->quality;
  options.subsampling = (*choice)->subsampling;
  return {};
}

Result<void> buildImages(const BuildArguments& a, base::Scene& scene, BuildReport& report, ProgressLine& line) {
  auto patches = lod::patch::PatchFile::open(a.output + "/patch.lgp");
  if (!patches) return patches.error();
  BakeOptions options = a.bake;
  options.grid = repository::makeGrid(scene.localBox(), a.grid, static_cast<float>(a.margin), a.face);
  options.subsampling = subsamplingOf(a.subsampling);
  options.threads = a.hierarchy.threads;
  LUMIGRID_TRY(chooseQuality(a, *patches, scene, report, options));
  auto store = repository::openLmdbStore(a.output + "/images", repository::StoreMode::kWrite);
  if (!store) return store.error();
  auto baked = bake(scene, *patches, **store, options, [&](const BakeProgress& p) {
    if (p.cells_total != 0) {
      line.show("cells of " + std::to_string(p.cell) + " steps",
                static_cast<double>(p.cells_judged) / static_cast<double>(p.cells_total), formatBytes(p.stored_bytes));
      return !stopRequested();
    }
    std::array<char, 64> rate{};
    std::snprintf(rate.data(), rate.size(), "%.1f images/s", p.faces_per_second);
    line.show("images",
              p.faces_total == 0
                  ? 1.0
                  : static_cast<double>(p.faces_done + p.faces_skipped) / static_cast<double>(p.faces_total),
              std::string(rate.data()) + ", " + formatBytes(p.stored_bytes));
    return !stopRequested();
  });
  line.finish();
  if (!baked) return baked.error();
  report.bake = *baked;
  if (!hasPart(scene, "images")) LUMIGRID_TRY(addPart(scene, a.output, "images"));
  return {};
}

nlohmann::json summaryJson(const base::Scene& scene, const BuildReport& r) {
  nlohmann::json j{
      {"triangles", scene.triangles}, {"repairs", scene.repairs}, {"peak_memory_bytes", peakResidentBytes()}};
  if (r.hierarchy) {
    const auto& h = *r.hierarchy;
    j["import_seconds"] = h.import_seconds;
    j["hierarchy"] = {
        {"seconds", h.seconds},
        {"cpu_seconds", h.cpu_seconds},
        {"bytes", h.bytes},
        {"triangles_per_second", static_cast<double>(scene.triangles) / std::max(h.seconds, 1e-9)},
        {"triangles_per_cpu_second", static_cast<double>(scene.triangles) / std::max(h.cpu_seconds, 1e-9)},
        {"levels", nlohmann::json::array()}};
    for (const auto& level : h.levels)
      j["hierarchy"]["levels"].push_back(
          {{"triangles", level.triangles}, {"patches", level.patches}, {"max_error", level.max_error}});
  }
  if (r.tuned) j["tuned"] = tunedJson(*r.tuned);
  if (r.bake) {
    const auto& b = *r.bake;
    j["images"] = {{"rendered", b.faces_rendered},
                   {"skipped", b.faces_skipped},
                   {"empty", b.faces_empty},
                   {"jpeg_bytes", b.jpeg_bytes},
                   {"coverage_bytes", b.coverage_bytes},
                   {"seconds", b.seconds},
                   {"images_per_second", static_cast<double>(b.faces_rendered) / std::max(b.seconds, 1e-9)}};
  }
  return j;
}

void printSummary(const BuildArguments& a, const base::Scene& scene, const BuildReport& r) {
  std::printf("%s: %s triangles\n", a.output.c_str(), formatCount(scene.triangles).c_str());
  for (const auto& [what, count] : scene.repairs)
    std::printf("  repaired: %s %s\n", formatCount(count).c_str(), what.c_str());
  if (r.hierarchy) {
    const auto& h = *r.hierarchy;
    std::printf("hierarchy: %.0f triangles/s (%.0f per core), %s in %s\n",
                static_cast<double>(scene.triangles) / std::max(h.seconds, 1e-9),
                static_cast<double>(scene.triangles) / std::max(h.cpu_seconds, 1e-9), formatBytes(h.bytes).c_str(),
                formatSeconds(h.seconds).c_str());
    for (std::size_t level = 0; level < h.levels.size(); ++level)
      std::printf("  level %2zu: %12s triangles %8s patches, error up to %g\n", level,
                  formatCount(h.levels[level].triangles).c_str(), formatCount(h.levels[level].patches).c_str(),
                  static_cast<double>(h.levels[level].max_error));
  }
  if (r.tuned) std::printf("tuned to %s dB: %s\n", a.tune.c_str(), describeChoice(*r.tuned).c_str());
  if (r.bake) {
    const auto& b = *r.bake;
    std::printf("images: %.1f images/s; %s rendered (%s empty), %s were there already; %s JPEG, %s coverage\n",
                static_cast<double>(b.faces_rendered) / std::max(b.seconds, 1e-9),
                formatCount(b.faces_rendered).c_str(), formatCount(b.faces_empty).c_str(),
                formatCount(b.faces_skipped).c_str(), formatBytes(b.jpeg_bytes).c_str(),
                formatBytes(b.coverage_bytes).c_str());
  }
  std::printf("peak memory %s\nnext: lumigrid serve %s\n", formatBytes(peakResidentBytes()).c_str(), a.output.c_str());
}

Result<void> build(const BuildArguments& a) {
  auto sources = describeSources(a);
  if (!sources) return sources.error();
  auto resumed = openOutput(a, *sources);
  if (!resumed) return resumed.error();
  ProgressLine line(a.quiet);
  BuildReport report;

  base::Scene scene;
  if (resumed->has_value() && hasPart(**resumed, "patch.lgp")) {
    scene = std::move(**resumed);
  } else {
    auto built = buildPatches(a, *sources, report, line);
    if (!built) return built.error();
    scene = std::move(*built);
  }
  if (wants(a, "images")) LUMIGRID_TRY(buildImages(a, scene, report, line));

  LUMIGRID_TRY(base::writeSceneFile(scene, a.output + "/scene.json"));
  std::error_code ignored;
  fs::remove(fs::path(a.output) / base::kBuildingFile, ignored);
  // What runs killed while they wrote them left.
  for (const char* name : kWrittenWhole) base::removeUnfinished(a.output + "/" + name);
  if (a.json)
    std::printf("%s\n", summaryJson(scene, report).dump().c_str());
  else
    printSummary(a, scene, report);
  return {};
}

}  // namespace

Run addBuild(CLI::App& command) {
  auto a = std::make_shared<BuildArguments>();
  command.add_option("MESH", a->meshes, "PLY, OBJ, STL, OFF or GLB files; several make one scene")->required();
  command.add_option("-o,--output", a->output, "scene directory to make, or to go on with")->required();
  command.add_flag("--force", a->force, "replace a scene that is there");
  command
      .add_option("--methods", a->methods, "what to build: patch (the hierarchy), images (the repository; needs patch)")
      ->delimiter(',')
      ->check(CLI::IsMember({"patch", "images"}))
      ->capture_default_str();
  command.add_option("--grid", a->grid, "sampling points along the longest side of the viewing box")
      ->check(CLI::Range(2, 1024))
      ->capture_default_str();
  command
      .add_option("--margin", a->margin, "viewing box beyond the model on every side, in longest sides of the model")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  command
      .add_option(
          "--target", a->bake.target_db,
          "adaptive sampling: --grid is the finest grid, and a cell is split only where views blended from its "
          "corners miss the truth by more than so many dB (PSNR of foreground pixels, e.g. 30); 0: the whole grid")
      ->check(CLI::Range(0.0, 60.0))
      ->capture_default_str();
  command
      .add_option("--gain", a->bake.least_gain_db,
                  "adaptive sampling: and only where one more image in the cell's middle gains at least so many dB")
      ->check(CLI::Range(0.0, 60.0))
      ->capture_default_str();
  command
      .add_option("--coarse-cells", a->bake.coarse_cells,
                  "adaptive sampling: cells along the longest side to begin with, at least")
      ->check(CLI::Range(1, 1023))
      ->capture_default_str();
  command.add_option("--face", a->face, "pixels along one side of an image")
      ->check(CLI::Range(16, 4096))
      ->capture_default_str();
  const CLI::Option* quality = command.add_option("--quality", a->bake.quality, "JPEG quality")
                                   ->check(CLI::Range(1, 100))
                                   ->capture_default_str();
  const CLI::Option* subsampling =
      command
          .add_option("--subsampling", a->subsampling,
                      "JPEG chroma subsampling; 420 halves the bytes, 444 keeps strong colours")
          ->check(CLI::IsMember({"420", "422", "444"}))
          ->capture_default_str();
  command
      .add_option(
          "--tune", a->tune,
          "off, or a PSNR in dB, e.g. 36: takes the quality and subsampling of fewest bytes that reach it on the "
          "model's pixels of a sample of " +
              std::to_string(kTuneFaces) + " images")
      ->capture_default_str();
  command.add_option("--tolerance", a->bake.tolerance_px, "largest projected error in the images, face pixels")
      ->check(CLI::Range(0.0F, 100.0F))
      ->capture_default_str();
  command.add_option("--supersampling", a->bake.supersampling, "n x n samples per face pixel")
      ->check(CLI::Range(1, 8))
      ->capture_default_str();
  command.add_option("--batch", a->bake.batch_faces, "images per commit: the most a killed build loses")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command
      .add_option("--light", a->light,
                  "unlit: colours as scanned; soft: a soft directional light; auto: unlit where the mesh has colours")
      ->check(CLI::IsMember({"auto", "unlit", "soft"}))
      ->capture_default_str();
  command.add_option("--up", a->up, "axis that points up in the first view")
      ->check(CLI::IsMember({"auto", "x", "y", "z"}))
      ->capture_default_str();
  command.add_option("--units", a->units, "unit of length of the mesh, e.g. m; kept in scene.json")
      ->capture_default_str();
  command.add_option("--voxel-triangles", a->hierarchy.voxel_triangles, "Nv: most triangles in a voxel")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  command.add_option("--leaf-triangles", a->hierarchy.leaf_triangles, "Nl: most triangles in a leaf patch")
      ->check(CLI::Range(16, 20'000))
      ->capture_default_str();
  command.add_option("--node-triangles", a->hierarchy.node_triangles, "Nn: most triangles in any other patch")
      ->check(CLI::Range(16, 20'000))
      ->capture_default_str();
  command
      .add_option("--position-bits", a->hierarchy.position_bits,
                  "lattice steps along the longest side, as a power of two, 10 to 21; 0: chosen from the mean edge")
      ->check(CLI::Range(0, 21))
      ->capture_default_str();
  command.add_option("--threads", a->hierarchy.threads, "0: all cores; the result does not depend on it")
      ->capture_default_str();
  command
      .add_option("--memory", a->hierarchy.memory_bytes,
                  "most memory to use while the hierarchy is built, e.g. 4G, at least 256M; 0: 60 % of the machine's; "
                  "the result does not depend on it")
      ->transform(CLI::AsSizeValue(false))
      ->capture_default_str();
  command.add_option("--tmpdir", a->tmpdir,
                     "directory for work files, about 60 bytes per triangle; default: within the scene");
  command
      .add_option("--regroup", a->regroup,
                  "on: new groups of patches at each level; off: the paper's binary tree, whose locked borders pile up")
      ->check(CLI::IsMember({"on", "off"}))
      ->capture_default_str();
  command.add_flag("--json", a->json, "summary as JSON");
  command.add_flag("--quiet", a->quiet, "no progress");
  return [a, quality, subsampling]() -> int {
    if (!parseTune(a->tune, a->tune_db)) {
      std::fprintf(stderr, "lumigrid: --tune %s: give off, or a PSNR in dB above 0 and below 99, e.g. 36\n",
                   a->tune.c_str());
      return kWrongUsage;
    }
    if (a->tune_db && (quality->count() > 0 || subsampling->count() > 0 || !wants(*a, "images"))) {
      std::fprintf(stderr, "lumigrid: --tune chooses quality and subsampling of the images: leave out %s\n",
                   !wants(*a, "images") ? "--tune, or build images" : "--quality and --subsampling, or --tune");
      return kWrongUsage;
    }
    if (wants(*a, "images") && !wants(*a, "patch")) {
      std::fprintf(stderr, "lumigrid: --methods images needs patch as well\n");
      return kWrongUsage;
    }
    stopOnSignals();
    auto done = build(*a);
    return done ? kDone : fail(done.error());
  };
}

}  // namespace server::cmd
