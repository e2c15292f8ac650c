// lumigrid build: import, hierarchy, repository, one after the other, each resumable.
//
// A build in progress keeps scene.json's document as building.json. What is finished is listed in its parts; a rerun
// with the same sources and options goes on from there. scene.json appears when everything is in place.
//
// Any number of processes may work on one scene. What concerns the scene as a whole is done under its lock (SceneLock):
// making or opening it with its hierarchy, and declaring it finished. Between the two each process renders its shards,
// each under the lock of the shard's store; who finds that nothing is missing writes scene.json.
#include <sys/stat.h>
#include <unistd.h>
#if defined(__GLIBC__)
#endif

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <future>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/crc32c.h"
#include "base/json/scene_file.h"
#include "base/memory.h"
#include "lod/ingest/work_directory.h"
#include "lod/patch/builder/hierarchy_build.h"
#include "lod/patch/format.h"
#include "lod/qsplat/builder/build.h"
#include "repository/repository.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/tree_text.h"
#include "repository/store.h"
#include "repository/verify.h"
#include "server/bake/adaptive.h"
#include "server/bake/bake.h"
#include "server/bake/draw_processes.h"
#include "server/bake/tune.h"
#include "server/bake/viewer_use.h"
#include "server/cli/commands.h"
#include "server/cli/console.h"
#include "server/cli/scene_images.h"
#include "server/cli/scene_lock.h"
#include "server/cli/scene_sources.h"
#include "server/cli/shard_choice.h"
#include "server/cli/splat_info.h"
#include "server/cli/tuned.h"

namespace server::cli {
namespace {

namespace fs = std::filesystem;
using base::Error;
using base::ErrorCode;
using base::Result;

struct BuildArguments {
  std::vector<std::string> meshes;
  std::string output;
  std::vector<std::string> methods{"patch", "images"};
  bool force = false, json = false, quiet = false, missing = false, splats_coded = false;
  std::string shard;         // i/n or auto, as given
  std::uint32_t shards = 0;  // 0: as the scene records, or one store
  std::string light = "auto", up = "auto", units = "unknown", subsampling = "420", tune = "off";
  std::optional<double> tune_db;  // --tune in dB, nothing: off
  std::uint32_t grid = 32, face = 512;
  double margin = 0.5;
  std::string tmpdir, regroup = "on";
  std::string refine_from;  // a scene; empty: none
  lod::patch::builder::HierarchyOptions hierarchy;
  double splats_dice = lod::qsplat::builder::kDefaultDice;
  BakeOptions bake;
};

// A method that has a file, with its work files beside it unless --tmpdir says otherwise.
struct FileMethod {
  const char* method;
  const char* file;
  const char* work_files;
};
constexpr FileMethod kPatches{"patch", "patch.lgp", "patch.lgp.work"};
constexpr FileMethod kSplats{"qsplat", "qsplat.lgq", "qsplat.lgq.work"};
constexpr FileMethod kFileMethods[] = {kPatches, kSplats};
constexpr const char* kMethods[] = {"patch", "images", "qsplat"};

constexpr const char* kWrittenWhole[] = {kPatches.file, kSplats.file, "scene.json", base::kBuildingFile};

// Of the options below, those that decide what scene.json says of the source, and the patch hierarchy besides.
constexpr const char* kSourceParameters[] = {"light", "up", "units"};
/// There where the tree of splats is in the coded form.
constexpr const char* kSplatsCoded = "qsplat-coded";
constexpr const char* kHierarchyParameters[] = {"voxel-triangles", "leaf-triangles", "node-triangles", "position-bits",
                                                "regroup"};

/// How the triangles of a tree of splats were diced, where the scene has one. Trees from before this was kept were not.
constexpr const char* kSplatsDice = "qsplat-dice";

// Where adaptive sampling needs images shows from those that are there: its points cannot be dealt out in advance.
constexpr const char* kAdaptiveIsWhole =
    "adaptive sampling (--target, --views) builds one undivided repository: leave that out, or --shard and --shards";

/// What the summary tells.
struct BuildReport {
  std::optional<lod::patch::builder::HierarchySummary> hierarchy;  ///< absent when a resumed build had it already
  std::optional<lod::qsplat::builder::BuildSummary> splats;        ///< the same
  std::optional<TuneChoice> tuned;
  std::optional<BakeSummary> bake;             ///< over all shards that this process did
  repository::RemovalCounts removed;           ///< from a finished scene: rendered again, or not ours
  std::vector<repository::ShardGaps> missing;  ///< when it was over: other shards' faces
};

/// The scene in the output directory, when there is one that fits the command.
struct Output {
  std::optional<base::Scene> scene;  ///< with its hierarchy; nothing for a fresh start
  bool finished = false;             ///< as scene.json; only faults are looked for
  std::string noted;                 ///< what this process last wrote of it
};

/// Which part of the images a command is about.
struct Part {
  std::uint32_t shards = 0;            ///< the division; 0: none
  std::optional<std::uint32_t> index;  ///< nothing: all of them
};

bool wants(const BuildArguments& a, const char* method) {
  return std::find(a.methods.begin(), a.methods.end(), method) != a.methods.end();
}

// The options that decide what the scene holds, as scene.json keeps them. Threads, batches and messages are not among
// them.
Parameters parametersOf(const BuildArguments& a) {
  auto number = [](auto v) { return nlohmann::json(v).dump(); };
  std::string methods;
  for (const char* method : kMethods)
    if (wants(a, method)) methods += (methods.empty() ? "" : ",") + std::string(method);
  Parameters parameters{{"methods", methods},
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
  if (a.bake.demand_views != 0) {
    parameters["views"] = number(a.bake.demand_views);
    parameters["worth"] = number(a.bake.demand_worth);
  }
  if (a.bake.budget_bytes != 0) parameters["budget"] = number(a.bake.budget_bytes);
  if (!a.refine_from.empty()) parameters["refine-from"] = a.refine_from;
  if (wants(a, "qsplat")) parameters[kSplatsDice] = number(a.splats_dice);
  if (a.splats_coded) parameters[kSplatsCoded] = "true";
  return parameters;
}

// A source whose hash was not worked out is known by its size.
bool sameSources(const std::vector<base::SceneSource>& a, const std::vector<base::SceneSource>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const auto& x, const auto& y) {
    return x.bytes == y.bytes && (x.sha256 == y.sha256 || x.sha256.empty() || y.sha256.empty());
  });
}

// A file that was being written when its writer was killed.
bool isUnfinished(const std::string& name) {
  return std::any_of(std::begin(kWrittenWhole), std::end(kWrittenWhole),
                     [&](const char* whole) { return base::isUnfinished(name, whole); });
}

// Removes what a scene consists of, and nothing else that may lie in the directory. Refused while somebody writes it.
Result<void> clear(const std::string& directory) {
  const std::string images = directory + "/images";
  LUMIGRID_ASSIGN_OR_RETURN(auto layout, repository::layoutOf(images));
  for (const repository::Shard& shard : layout.shards)
    LUMIGRID_TRY(repository::removeLmdbStore(repository::storeDirectory(images, shard.count, shard.index)));
  if (layout.undivided) LUMIGRID_TRY(repository::removeLmdbStore(images));
  for (const char* name : {"scene.json", base::kBuildingFile, kPatches.file, kPatches.work_files, kSplats.file,
                           kSplats.work_files, "images", "access.lga", "access.lga.lock"}) {
    std::error_code error;
    fs::remove_all(fs::path(directory) / name, error);
    if (error) return Error{ErrorCode::kIo, directory + "/" + name + ": cannot remove: " + error.message()};
  }
  return {};
}

bool isPublished(const base::Scene& scene) {
  return std::any_of(scene.parts.begin(), scene.parts.end(),
                     [](const base::ScenePart& part) { return base::isPublishedName(part.file); });
}

enum class Fit { kSame, kMore, kOther };

bool hasMethod(const Parameters& parameters, const std::string& method) {
  const auto it = parameters.find("methods");
  if (it == parameters.end()) return false;
  return ("," + it->second + ",").find("," + method + ",") != std::string::npos;
}

// Whether the scene is what the command makes (kSame: at least that, but for methods with a file, which are added to
// any scene), or has just the hierarchy that it needs (kMore: images are to be added, or none is there yet and they may
// be encoded in another way), or is another one.
Fit fitOf(const BuildArguments& a, const std::vector<base::SceneSource>& sources, const base::Scene& scene,
          bool has_images) {
  if (!a.meshes.empty() && !sameSources(scene.sources, sources)) return Fit::kOther;
  Parameters recorded = withoutChoice(scene.parameters);
  recorded.erase(kShardsParameter);
  Parameters wanted = parametersOf(a);
  for (const char* name : kSourceParameters)
    if (recorded[name] != wanted.at(name)) return Fit::kOther;
  if (wants(a, "patch") && hasMethod(recorded, "patch"))
    for (const char* name : kHierarchyParameters)
      if (recorded[name] != wanted.at(name)) return Fit::kOther;
  if (wants(a, "qsplat") && hasMethod(recorded, "qsplat")) {
    if (recorded.contains(kSplatsCoded) != a.splats_coded) return Fit::kOther;
    const auto diced = recorded.find(kSplatsDice);
    if ((diced == recorded.end() ? "0.0" : diced->second) != wanted.at(kSplatsDice)) return Fit::kOther;
  }
  if (!wants(a, "images")) return Fit::kSame;
  if (!wantsImages(scene)) return Fit::kMore;
  for (const char* name : {"methods", kSplatsDice, kSplatsCoded}) {
    recorded.erase(name);
    wanted.erase(name);
  }
  if (recorded == wanted) return Fit::kSame;
  return !has_images && withoutEncoding(recorded) == withoutEncoding(wanted) ? Fit::kMore : Fit::kOther;
}

// What the scene has, and what the command adds.
void addMethods(const Parameters& of, Parameters& to) {
  if (of.contains(kSplatsCoded)) to[kSplatsCoded] = of.at(kSplatsCoded);
  std::string methods;
  for (const char* method : kMethods)
    if (hasMethod(of, method) || hasMethod(to, method)) methods += (methods.empty() ? "" : ",") + std::string(method);
  to["methods"] = methods;
  if (const auto it = of.find(kSplatsDice); it != of.end()) to.insert(*it);
}

// The command's options; the scene's methods and division stay.
void takeParameters(const BuildArguments& a, base::Scene& scene) {
  Parameters parameters = parametersOf(a);
  addMethods(scene.parameters, parameters);
  if (const auto it = scene.parameters.find(kShardsParameter); it != scene.parameters.end()) parameters.insert(*it);
  scene.parameters = std::move(parameters);
}

/// The scene to go on with or to look over, or nothing for a fresh start; an error when the output may not be touched.
Result<Output> openOutput(const BuildArguments& a, const SceneSources& sources) {
  Output output;
  if (a.force || !fs::exists(a.output)) return output;
  if (!fs::is_directory(a.output))
    return Error{ErrorCode::kExists, a.output + ": is a file, not a scene directory; choose another output"};
  output.finished = fs::exists(fs::path(a.output) / "scene.json");
  const std::string file = a.output + "/" + (output.finished ? "scene.json" : base::kBuildingFile);
  if (output.finished || fs::exists(file)) {
    LUMIGRID_ASSIGN_OR_RETURN(auto scene, base::readSceneFile(file));
    if (isPublished(scene))
      return Error{ErrorCode::kExists, a.output +
                                           ": is a published scene; build the one that it was published from, and "
                                           "publish that again"};
    LUMIGRID_ASSIGN_OR_RETURN(const auto layout, repository::layoutOf(a.output + "/images"));
    const bool has_images = output.finished || layout.undivided || !layout.shards.empty();
    LUMIGRID_ASSIGN_OR_RETURN(const auto list, sources.all());
    const Fit fit = fitOf(a, list, scene, has_images);
    if (fit == Fit::kOther && output.finished)
      return Error{ErrorCode::kExists,
                   a.output +
                       ": holds a finished scene of other meshes or options already; choose another "
                       "output, or say --force to build it again"};
    if (fit == Fit::kOther)
      return Error{
          ErrorCode::kExists,
          a.output +
              ": holds an unfinished build of other meshes or options; repeat those, or say --force to start afresh"};
    if (fit == Fit::kMore) {
      takeParameters(a, scene);
      output.finished = false;
    }
    output.scene = std::move(scene);
    return output;
  }
  // A build that was stopped on the way has left its work files, or a file that nothing lists yet.
  const bool only_work = std::all_of(fs::directory_iterator(a.output), fs::directory_iterator(), [](const auto& entry) {
    const std::string name = entry.path().filename().string();
    const bool of_method = std::any_of(std::begin(kFileMethods), std::end(kFileMethods), [&](const FileMethod& method) {
      return name == method.file || name == method.work_files;
    });
    return of_method || name == kLockFile || isUnfinished(name);
  });
  if (!only_work)
    return Error{ErrorCode::kExists,
                 a.output + ": is not empty and not a scene; choose another output, or say --force"};
  return output;
}

// Up, when not told: glTF says +y. A flat open scan stands on its shortest axis, on the side its surface faces;
// anything else is taken for a model with +y up, as scanners of objects write them.
glm::dvec3 guessUp(const lod::ingest::SourceSummary& built, const BuildArguments& a) {
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

void describeMesh(const lod::ingest::SourceSummary& built, const BuildArguments& a, base::Scene& scene) {
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

// A file that was built, as the scene lists it: hashed as soon as it is there.
class BuiltPart {
 public:
  BuiltPart(const std::string& directory, const std::string& file) : path_(directory + "/" + file), file_(file) {}
  /// What a build calls then.
  std::function<void()> onWritten() {
    return [this] { hash_ = std::async(std::launch::async, [this] { return base::sha256OfFile(path_); }); };
  }
  /// After the build.
  Result<void> addTo(base::Scene& scene) {
    LUMIGRID_ASSIGN_OR_RETURN(auto hash, hash_.get());
    std::erase_if(scene.parts, [&](const base::ScenePart& old) { return old.file == file_; });
    scene.parts.push_back({file_, fs::file_size(path_), hash});
    return {};
  }

 private:
  std::string path_;
  std::string file_;
  std::future<Result<std::string>> hash_;
};

bool hasPart(const base::Scene& scene, const std::string& file) {
  return std::any_of(scene.parts.begin(), scene.parts.end(),
                     [&](const base::ScenePart& part) { return part.file == file; });
}

// Listed, and there with the size that is listed.
bool hasFile(const BuildArguments& a, const base::Scene& scene, const FileMethod& method) {
  return std::any_of(scene.parts.begin(), scene.parts.end(), [&](const base::ScenePart& part) {
    std::error_code error;
    return part.file == method.file && fs::file_size(fs::path(a.output) / part.file, error) == part.bytes;
  });
}
bool lacks(const BuildArguments& a, const base::Scene& scene, const FileMethod& method) {
  return wants(a, method.method) && !hasFile(a, scene, method);
}

// One place for each output and method, so that several builds can share a directory.
std::string workDirectory(const BuildArguments& a, const FileMethod& method) {
  if (a.tmpdir.empty()) return a.output + "/" + method.work_files;
  const std::string output = fs::absolute(a.output).lexically_normal().string();
  std::array<char, 16> name{};
  std::snprintf(name.data(), name.size(), "%08x",
                base::crc32c({reinterpret_cast<const std::uint8_t*>(output.data()), output.size()}));
  const std::string suffix = method.file == std::string(kPatches.file) ? "" : std::string("-") + method.method;
  return a.tmpdir + "/lumigrid-" + name.data() + suffix;
}

// What decides the hierarchy besides its own options. To be called while `sources` are there.
lod::ingest::ResumeKey resumeKey(const SceneSources& sources) {
  return [&sources]() -> Result<std::string> {
    LUMIGRID_ASSIGN_OR_RETURN(const auto list, sources.all());
    std::string key;
    for (const base::SceneSource& source : list) key += source.sha256 + " ";
    return key;
  };
}

Result<void> needMeshes(const BuildArguments& a, const std::string& what) {
  if (!a.meshes.empty()) return {};
  return Error{ErrorCode::kNotFound, a.output + ": holds no " + what + " yet; give the meshes too"};
}

void printPlan(const BuildArguments& a, ProgressLine& line, const lod::ingest::BuildPlan& plan) {
  if (a.quiet) return;
  line.finish();
  const bool points = plan.triangles == 0;
  std::fprintf(stderr, "%s %s: about %s in the scene, up to %s of work files, about %s\n",
               formatCount(points ? plan.vertices : plan.triangles).c_str(), points ? "points" : "triangles",
               formatBytes(plan.output_bytes).c_str(), formatBytes(plan.work_bytes).c_str(),
               formatSeconds(plan.seconds).c_str());
}

lod::ingest::Progress progressOn(ProgressLine& line, const std::string& what) {
  return [&line, what](const std::string& stage, double done) {
    line.show(what + ": " + stage, done);
    return !stopRequested();
  };
}

void printWarnings(const lod::ingest::SourceSummary& summary) {
  for (const std::string& warning : summary.warnings) std::fprintf(stderr, "lumigrid: warning: %s\n", warning.c_str());
}

Result<base::Scene> sceneOf(const BuildArguments& a, const SceneSources& sources,
                            const lod::ingest::SourceSummary& summary) {
  LUMIGRID_ASSIGN_OR_RETURN(auto list, sources.all());
  base::Scene scene;
  scene.sources = std::move(list);
  scene.parameters = parametersOf(a);
  describeMesh(summary, a, scene);
  return scene;
}

/// The hierarchy, from the files. What was found wrong with the meshes leaves nothing behind; what can go on later
/// leaves its work files.
Result<void> buildPatches(const BuildArguments& a, const SceneSources& sources, std::optional<base::Scene>& scene,
                          BuildReport& report, ProgressLine& line) {
  LUMIGRID_TRY(needMeshes(a, "hierarchy"));
  lod::patch::builder::HierarchyOptions options = a.hierarchy;
  options.regroup = a.regroup == "on";
  options.work_directory = workDirectory(a, kPatches);
  options.resume_key = resumeKey(sources);
  options.on_plan = [&](const lod::ingest::BuildPlan& plan) { printPlan(a, line, plan); };
  BuiltPart part(a.output, kPatches.file);
  options.on_written = part.onWritten();
  auto summary = lod::patch::builder::buildHierarchyFromFiles(a.meshes, options, a.output + "/" + kPatches.file,
                                                              progressOn(line, "hierarchy"));
  line.finish();
  if (!summary) return summary.error();
  printWarnings(*summary);
  // The patches are the scene as it is looked at: what they say of the source counts.
  LUMIGRID_ASSIGN_OR_RETURN(auto described, sceneOf(a, sources, *summary));
  if (scene) {
    const Parameters wanted = std::move(described.parameters);
    described.parameters = scene->parameters;  // with the division
    for (const char* name : kHierarchyParameters) described.parameters[name] = wanted.at(name);
    described.parts = scene->parts;
  }
  scene = std::move(described);
  report.hierarchy = std::move(*summary);
  return part.addTo(*scene);
}

/// The tree of splats, from the files, in the same way.
Result<void> buildSplats(const BuildArguments& a, const SceneSources& sources, std::optional<base::Scene>& scene,
                         BuildReport& report, ProgressLine& line) {
  LUMIGRID_TRY(needMeshes(a, "tree of splats"));
  lod::qsplat::builder::BuildOptions options;
  options.limits = a.hierarchy.limits;
  options.dice = a.splats_dice;
  options.work_directory = workDirectory(a, kSplats);
  options.resume_key = resumeKey(sources);
  options.coded = a.splats_coded;
  options.on_plan = [&](const lod::ingest::BuildPlan& plan) { printPlan(a, line, plan); };
  BuiltPart part(a.output, kSplats.file);
  options.on_written = part.onWritten();
  auto summary = lod::qsplat::builder::buildFromFiles(a.meshes, options, a.output + "/" + kSplats.file,
                                                      progressOn(line, "splats"));
  line.finish();
  if (!summary) return summary.error();
  if (!scene) {
    printWarnings(*summary);
    LUMIGRID_ASSIGN_OR_RETURN(auto described, sceneOf(a, sources, *summary));
    scene = std::move(described);
  }
  report.splats = std::move(*summary);
  return part.addTo(*scene);
}

repository::Subsampling subsamplingOf(const std::string& name) {
  return name == "444"   ? repository::Subsampling::k444
         : name == "422" ? repository::Subsampling::k422
                         : repository::Subsampling::k420;
}

repository::Grid gridFor(const BuildArguments& a, const base::Scene& scene) {
  return repository::makeGrid(scene.localBox(), a.grid, static_cast<float>(a.margin), a.face);
}

std::string imagesOf(const BuildArguments& a) {
  return a.output + "/images";
}

// This program, to draw in several processes.
std::vector<std::string> drawCommand() {
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  if (error) return {};
  return {program.string(), kDrawCommand};
}

// What is drawn, for all shards alike.
BakeOptions bakeOptions(const BuildArguments& a, const base::Scene& scene) {
  BakeOptions options = a.bake;
  options.grid = gridFor(a, scene);
  options.subsampling = subsamplingOf(a.subsampling);
  options.threads = a.hierarchy.limits.threads;
  options.memory_bytes = a.hierarchy.limits.resolved().memory_bytes;
  options.draw_command = drawCommand();
  return options;
}

/// With --tune: the choice that an earlier run or another shard's kept in the scene's parameters, or a new one. Under
/// the scene's lock, so that all shards take the same.
Result<void> chooseQuality(const BuildArguments& a, Output& output, BuildReport& report) {
  if (!a.tune_db) return {};
  base::Scene& scene = *output.scene;
  auto choice = storedChoice(scene.parameters);
  if (!choice)
    return base::within(a.output + "/" + (output.finished ? "scene.json" : base::kBuildingFile), choice.error());
  if (!*choice) {
    LUMIGRID_ASSIGN_OR_RETURN(auto patches, lod::patch::PatchFile::open(a.output + "/patch.lgp"));
    auto tuned = tuneScene(scene, patches, bakeOptions(a, scene), *a.tune_db);
    if (!tuned) return base::within("--tune", tuned.error());
    *choice = *tuned;
    storeChoice(**choice, scene.parameters);
  }
  report.tuned = **choice;
  return {};
}

// The tree with which adaptive sampling begins; nothing where the whole grid is sampled.
std::optional<repository::SampleTree> firstTree(const BuildArguments& a, const repository::Grid& grid) {
  if (!isAdaptive(a.bake)) return std::nullopt;
  return repository::SampleTree(grid, coarseCellSize(grid, a.bake.coarse_cells));
}

Result<std::vector<repository::ShardGaps>> missingImages(const BuildArguments& a, const base::Scene& scene,
                                                         std::uint32_t shards) {
  const repository::Grid grid = gridFor(a, scene);
  const auto first_tree = firstTree(a, grid);
  return repository::findMissing(imagesOf(a), shards, grid, first_tree ? &*first_tree : nullptr);
}

// Faults of a store that is thought to be whole; its tree, if it has one, stays as it is.
Result<repository::RemovalCounts> removeFaulty(repository::Store& store, const BakeOptions& options,
                                               const std::string& directory) {
  LUMIGRID_ASSIGN_OR_RETURN(auto meta, store.readMeta());
  LUMIGRID_ASSIGN_OR_RETURN(auto tree, repository::treeFromText(meta.value_or(""), options.grid, directory));
  return repository::removeFaulty(store, options.grid, options.shard, tree ? &*tree : nullptr, options.threads);
}

void add(const BakeSummary& one, std::optional<BakeSummary>& sum) {
  if (!sum) sum.emplace();
  sum->faces_rendered += one.faces_rendered;
  sum->faces_skipped += one.faces_skipped;
  sum->faces_empty += one.faces_empty;
  sum->jpeg_bytes += one.jpeg_bytes;
  sum->coverage_bytes += one.coverage_bytes;
  sum->seconds += one.seconds;
}

// How much places are visited, for the sampling that follows it. A finished tree asks no more.
Result<void> takeUse(const BuildArguments& a, const base::Scene& scene, bool finished, BakeOptions& options) {
  if (a.refine_from.empty()) return {};
  if (finished) {
    options.use = [](const glm::vec3&, const glm::vec3&) { return 1.0; };
    return {};
  }
  auto use = ViewerUse::ofScene(a.refine_from, scene.origin);
  if (!use) return base::within("--refine-from", use.error());
  options.use = [use = std::make_shared<ViewerUse>(std::move(*use))](const glm::vec3& low, const glm::vec3& high) {
    return use->within(low, high);
  };
  return {};
}

// One store: what is wrong with a finished one goes first, then what is missing is rendered.
Result<void> buildStore(const BuildArguments& a, const base::Scene& scene, const repository::Shard& shard,
                        const std::string& directory, bool finished, BuildReport& report, ProgressLine& line) {
  LUMIGRID_ASSIGN_OR_RETURN(auto patches, lod::patch::PatchFile::open(a.output + "/patch.lgp"));
  LUMIGRID_ASSIGN_OR_RETURN(auto store, repository::openLmdbStore(directory, repository::StoreMode::kWrite));
  BakeOptions options = bakeOptions(a, scene);
  options.shard = shard;
  LUMIGRID_TRY(takeUse(a, scene, finished, options));
  if (const auto& tuned = report.tuned) {
    options.quality = tuned->quality;
    options.subsampling = tuned->subsampling;
  }
  if (finished) {
    LUMIGRID_ASSIGN_OR_RETURN(auto removed, removeFaulty(*store, options, directory));
    report.removed.damaged += removed.damaged;
    report.removed.orphans += removed.orphans;
  }
  const std::string stage =
      shard.count > 1 ? "images " + std::to_string(shard.index) + "/" + std::to_string(shard.count) : "images";
  auto baked = bake(scene, patches, *store, options, [&](const BakeProgress& p) {
    if (p.cells_total != 0) {
      line.show("cells of " + std::to_string(p.cell) + " steps",
                static_cast<double>(p.cells_judged) / static_cast<double>(p.cells_total), formatBytes(p.stored_bytes));
      return !stopRequested();
    }
    std::array<char, 64> rate{};
    std::snprintf(rate.data(), rate.size(), "%.1f images/s", p.faces_per_second);
    line.show(stage,
              p.faces_total == 0
                  ? 1.0
                  : static_cast<double>(p.faces_done + p.faces_skipped) / static_cast<double>(p.faces_total),
              std::string(rate.data()) + ", " + formatBytes(p.stored_bytes));
    return !stopRequested();
  });
  line.finish();
  if (!baked) return base::within(directory, baked.error());
  add(*baked, report.bake);
  return {};
}

// All shards one after the other; those that others are writing just now are left to them.
Result<void> buildAllShards(const BuildArguments& a, const base::Scene& scene, std::uint32_t shards, bool finished,
                            BuildReport& report, ProgressLine& line) {
  std::optional<Error> busy;
  for (std::uint32_t i = 0; i < shards; ++i) {
    const repository::Shard shard{i, shards};
    if (repository::pointsOf(shard, gridFor(a, scene)).size() == 0) continue;
    auto built =
        buildStore(a, scene, shard, repository::storeDirectory(imagesOf(a), shards, i), finished, report, line);
    if (built) continue;
    if (built.error().code != ErrorCode::kBusy) return built.error();
    busy = built.error();
  }
  return busy ? Result<void>(*busy) : Result<void>();
}

Result<void> buildImages(const BuildArguments& a, const base::Scene& scene, const Part& part, bool finished,
                         BuildReport& report, ProgressLine& line) {
  if (part.shards != 0 && !part.index) return buildAllShards(a, scene, part.shards, finished, report, line);
  const repository::Shard shard = part.index ? repository::Shard{*part.index, part.shards} : repository::Shard{};
  return buildStore(a, scene, shard, repository::storeDirectory(imagesOf(a), part.shards, shard.index), finished,
                    report, line);
}

nlohmann::json summaryJson(const base::Scene& scene, const BuildReport& r) {
  nlohmann::json j{{"triangles", scene.triangles},
                   {"repairs", scene.repairs},
                   {"peak_memory_bytes", peakResidentBytes()},
                   {"complete", r.missing.empty()},
                   {"removed", {{"damaged", r.removed.damaged}, {"orphans", r.removed.orphans}}}};
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
  if (r.splats) {
    const auto& q = *r.splats;
    if (!r.hierarchy) j["import_seconds"] = q.import_seconds;
    j["qsplat"] = splatsJson(q.header);
    j["qsplat"]["added_leaves"] = q.added_leaves;
    j["qsplat"]["seconds"] = q.seconds;
    j["qsplat"]["cpu_seconds"] = q.cpu_seconds;
    j["qsplat"]["leaves_per_cpu_second"] = static_cast<double>(q.header.leaves) / std::max(q.cpu_seconds, 1e-9);
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

// The last lines: what was put right in a finished scene, and what comes next.
void printOutcome(const BuildArguments& a, const Output& output, const BuildReport& r) {
  if (r.removed.damaged + r.removed.orphans > 0)
    std::printf("repaired: %s damaged images rendered again, %s removed that did not belong here\n",
                formatCount(r.removed.damaged).c_str(), formatCount(r.removed.orphans).c_str());
  else if (output.finished && !r.hierarchy && !r.splats && (!r.bake || r.bake->faces_rendered == 0))
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

void printSummary(const BuildArguments& a, const Output& output, const BuildReport& r) {
  const base::Scene& scene = *output.scene;
  const bool points = scene.triangles == 0 && r.splats;
  std::printf("%s: %s %s\n", a.output.c_str(), formatCount(points ? r.splats->header.leaves : scene.triangles).c_str(),
              points ? "points" : "triangles");
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
  if (r.splats) {
    const auto& q = *r.splats;
    std::printf("splats: %.0f leaves/s (%.0f per core) in %s; %s\n",
                static_cast<double>(q.header.leaves) / std::max(q.seconds, 1e-9),
                static_cast<double>(q.header.leaves) / std::max(q.cpu_seconds, 1e-9), formatSeconds(q.seconds).c_str(),
                describeSplats(splatsJson(q.header)).c_str());
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
  printOutcome(a, output, r);
}

// --shard and --shards, or what an MPI launcher says.
Result<Part> partOf(const BuildArguments& a) {
  const Environment environment = [](const char* name) -> const char* { return std::getenv(name); };
  std::optional<repository::Shard> shard;
  if (a.shard.empty()) {
    LUMIGRID_ASSIGN_OR_RETURN(auto rank, shardFromRanks(environment));
    shard = rank;
  } else {
    LUMIGRID_ASSIGN_OR_RETURN(auto given,
                              a.shard == "auto" ? shardFromLauncher(environment) : repository::parseShard(a.shard));
    shard = given;
  }
  if (!shard) return Part{a.shards, std::nullopt};
  if (isAdaptive(a.bake)) return Error{ErrorCode::kInvalidInput, kAdaptiveIsWhole};
  if (a.shards != 0 && a.shards != shard->count)
    return Error{ErrorCode::kInvalidInput, "--shards " + std::to_string(a.shards) + " and a shard of " +
                                               std::to_string(shard->count) + " do not go together"};
  return Part{shard->count, shard->index};
}

// The scene's division is the first that was asked for: it stays while there are images.
Result<void> settleDivision(const BuildArguments& a, const Output& output, Part& part) {
  LUMIGRID_ASSIGN_OR_RETURN(auto recorded, shardsOf(*output.scene));
  if (recorded != 0 && isAdaptive(a.bake))
    return Error{ErrorCode::kInvalidInput, a.output + ": is divided into shards; " + kAdaptiveIsWhole};
  if (part.shards == 0 || part.shards == recorded) {
    part.shards = recorded;
    return {};
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto layout, repository::layoutOf(imagesOf(a)));
  if (!output.finished && !layout.undivided && layout.shards.empty()) return {};
  const std::string is = recorded == 0 ? "undivided" : "divided into " + std::to_string(recorded) + " shards";
  return Error{ErrorCode::kExists, a.output + ": its images are " + is + ", not into " + std::to_string(part.shards) +
                                       "; keep to that, or make the scene anew with --force"};
}

// Stores of another division hold nothing that anybody reads.
Result<void> removeOrphanStores(const BuildArguments& a, std::uint32_t shards) {
  LUMIGRID_ASSIGN_OR_RETURN(auto orphans, orphanStores(imagesOf(a), shards));
  for (const std::string& directory : orphans) {
    LUMIGRID_TRY(repository::removeLmdbStore(directory));
    std::fprintf(stderr, "lumigrid: removed %s, which is not of this scene's division\n", directory.c_str());
  }
  return {};
}

Result<void> note(const BuildArguments& a, Output& output) {
  const std::string text = base::formatScene(*output.scene);
  if (text == output.noted) return {};
  LUMIGRID_TRY(
      base::writeSceneFile(*output.scene, a.output + "/" + (output.finished ? "scene.json" : base::kBuildingFile)));
  output.noted = text;
  return {};
}

// What has been built so far is the scene's: a rerun finds it listed.
Result<void> noteBuilt(const BuildArguments& a, Output& output) {
  addMethods(parametersOf(a), output.scene->parameters);
  return note(a, output);
}

/// The scene with its hierarchies, found or made, and building.json as it should be. Under the scene's lock.
Result<Output> prepare(const BuildArguments& a, const SceneSources& sources, Part& part, BuildReport& report,
                       ProgressLine& line) {
  LUMIGRID_ASSIGN_OR_RETURN(auto output, openOutput(a, sources));
  if (a.force) {
    LUMIGRID_TRY(needMeshes(a, "hierarchy"));
    LUMIGRID_TRY(clear(a.output));
  }
  const bool lacks_patches = !output.scene ? wants(a, "patch") : lacks(a, *output.scene, kPatches);
  if (lacks_patches) {
    LUMIGRID_TRY(buildPatches(a, sources, output.scene, report, line));
    LUMIGRID_TRY(noteBuilt(a, output));
  }
  const bool lacks_splats = !output.scene ? wants(a, "qsplat") : lacks(a, *output.scene, kSplats);
  if (lacks_splats) {
    LUMIGRID_TRY(buildSplats(a, sources, output.scene, report, line));
    LUMIGRID_TRY(noteBuilt(a, output));
  }
  LUMIGRID_TRY(settleDivision(a, output, part));
  if (wants(a, "images")) {
    LUMIGRID_TRY(removeOrphanStores(a, part.shards));
    LUMIGRID_TRY(chooseQuality(a, output, report));
  }
  if (output.finished) return output;
  if (part.shards != 0) output.scene->parameters[kShardsParameter] = std::to_string(part.shards);
  LUMIGRID_TRY(note(a, output));
  std::error_code ignored;
  fs::remove(fs::path(a.output) / "scene.json", ignored);  // a scene that gets images is unfinished again
  return output;
}

/// scene.json, if nothing is missing. Under the scene's lock.
Result<void> finish(const BuildArguments& a, Output& output, const Part& part, BuildReport& report) {
  base::Scene& scene = *output.scene;
  if (wantsImages(scene) && !wants(a, "images")) return {};  // another command is at them
  if (wantsImages(scene)) {
    LUMIGRID_ASSIGN_OR_RETURN(auto missing, missingImages(a, scene, part.shards));
    report.missing = std::move(missing);
    if (!report.missing.empty()) return {};
  }
  if (!fs::exists(fs::path(a.output) / "scene.json")) {
    if (wantsImages(scene) && !hasPart(scene, "images")) scene.parts.push_back({"images", 0, ""});
    LUMIGRID_TRY(base::writeSceneFile(scene, a.output + "/scene.json"));
  }
  std::error_code ignored;
  fs::remove(fs::path(a.output) / base::kBuildingFile, ignored);
  // What runs killed while they wrote them left.
  for (const char* name : kWrittenWhole) base::removeUnfinished(a.output + "/" + name);
  return {};
}

Result<SceneLock> lockScene(const BuildArguments& a) {
  return SceneLock::take(a.output, [&](const std::string& holder) {
    if (!a.quiet)
      std::fprintf(stderr, "lumigrid: waiting for %s, which is preparing %s\n", holder.c_str(), a.output.c_str());
  });
}

Result<void> build(const BuildArguments& a) {
  base::keepFreedMemory();
  LUMIGRID_ASSIGN_OR_RETURN(auto part, partOf(a));
  if (a.force && part.index)
    return Error{ErrorCode::kInvalidInput,
                 "--force would remove what other shards made; make the hierarchy anew first: --methods patch --force"};
  const SceneSources sources(a.meshes, true);
  LUMIGRID_TRY(sources.check());
  ProgressLine line(a.quiet);
  BuildReport report;
  Result<Output> output = Output{};
  {
    LUMIGRID_ASSIGN_OR_RETURN(const auto lock, lockScene(a));
    output = prepare(a, sources, part, report, line);
    if (!output) return output.error();
  }
  if (wants(a, "images")) LUMIGRID_TRY(buildImages(a, *output->scene, part, output->finished, report, line));
  {
    LUMIGRID_ASSIGN_OR_RETURN(const auto lock, lockScene(a));
    LUMIGRID_TRY(finish(a, *output, part, report));
  }
  if (a.json)
    std::printf("%s\n", summaryJson(*output->scene, report).dump().c_str());
  else
    printSummary(a, *output, report);
  return {};
}

// ---- What is missing ----

// Cheap, so that it can be asked often: sources are known by their sizes, images by their keys.
Result<MissingParts> findMissingParts(const BuildArguments& a) {
  LUMIGRID_ASSIGN_OR_RETURN(auto part, partOf(a));
  const SceneSources sources(a.meshes, false);
  LUMIGRID_TRY(sources.check());
  LUMIGRID_ASSIGN_OR_RETURN(auto output, openOutput(a, sources));
  MissingParts missing;
  missing.shards = part.shards;
  if (!output.scene) {
    missing.hierarchy = wants(a, "patch");
    missing.splats = wants(a, "qsplat");
    return missing;
  }
  const base::Scene& scene = *output.scene;
  LUMIGRID_TRY(settleDivision(a, output, part));
  missing.shards = part.shards;
  missing.hierarchy = lacks(a, scene, kPatches);
  missing.splats = lacks(a, scene, kSplats);
  if (!wants(a, "images")) {
    missing.declaration = !missing.files() && !output.finished && !wantsImages(scene);
    return missing;
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto images, missingImages(a, scene, part.shards));
  missing.images = std::move(images);
  if (part.index) std::erase_if(missing.images, [&](const auto& one) { return one.shard.index != *part.index; });
  missing.declaration = !missing.files() && !output.finished && missing.images.empty() && !part.index;
  return missing;
}

// The options, each with its default.
void declareOptions(CLI::App& command, BuildArguments& a) {
  command.add_option("MESH", a.meshes,
                     "PLY, OBJ, STL, OFF or GLB files; several make one scene. May be left out once the scene has its "
                     "hierarchy: then the options that are not given are those that the scene records");
  command.add_option("-o,--output", a.output, "scene directory to make, or to go on with")->required();
  command.add_flag("--force", a.force, "replace a scene that is there");
  command
      .add_option("--methods", a.methods,
                  "what to build: patch (the hierarchy), images (the repository; needs patch), qsplat (a tree of "
                  "splats; also from point clouds, PLY files without faces). A scene that is there gets what it lacks")
      ->delimiter(',')
      ->check(CLI::IsMember(std::vector<std::string>(std::begin(kMethods), std::end(kMethods))))
      ->capture_default_str();
  command.add_flag("--qsplat-coded", a.splats_coded,
                   "write the tree of splats entropy-coded: about half of the bytes, on disk and over a link, for some "
                   "of the viewer's time (default: plain)");
  command.add_option("--grid", a.grid, "sampling points along the longest side of the viewing box")
      ->check(CLI::Range(2, 1024))
      ->capture_default_str();
  command.add_option("--margin", a.margin, "viewing box beyond the model on every side, in longest sides of the model")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  command
      .add_option(
          "--target", a.bake.target_db,
          "adaptive sampling: --grid is the finest grid, and a cell is split only where views blended from its "
          "corners miss the truth by more than so many dB (PSNR of foreground pixels, e.g. 30); 0: the whole grid")
      ->check(CLI::Range(0.0, 60.0))
      ->capture_default_str();
  command
      .add_option("--gain", a.bake.least_gain_db,
                  "adaptive sampling: and only where one more image in the cell's middle gains at least so many dB")
      ->check(CLI::Range(0.0, 60.0))
      ->capture_default_str();
  command
      .add_option(
          "--budget", a.bake.budget_bytes,
          "adaptive sampling: cells are split while images and masks take about so many bytes, e.g. 200M; 0: no "
          "limit")
      ->transform(CLI::AsSizeValue(false))
      ->capture_default_str();
  command.add_option("--refine-from", a.refine_from,
                     "adaptive sampling: another scene of the same place that was served; cells are split only where "
                     "its access counts say that viewers came, the most visited first");
  command
      .add_option("--coarse-cells", a.bake.coarse_cells,
                  "adaptive sampling: cells along the longest side to begin with, at least")
      ->check(CLI::Range(1, 1023))
      ->capture_default_str();
  command
      .add_option("--views", a.bake.demand_views,
                  "sampling by use: of --grid only those points that a client would be sent in so many random views of "
                  "the viewing box, e.g. 1000; 0: the whole grid")
      ->check(CLI::Range(0, 1'000'000))
      ->capture_default_str();
  command
      .add_option("--worth", a.bake.demand_worth,
                  "sampling by use: points are left out while what is left is worth this share of the whole grid to "
                  "these views")
      ->check(CLI::Range(0.01, 1.0))
      ->capture_default_str();
  command.add_option("--face", a.face, "pixels along one side of an image")
      ->check(CLI::Range(16, 4096))
      ->capture_default_str();
  command.add_option("--quality", a.bake.quality, "JPEG quality")->check(CLI::Range(1, 100))->capture_default_str();
  command
      .add_option("--subsampling", a.subsampling,
                  "JPEG chroma subsampling; 420 halves the bytes, 444 keeps strong colours")
      ->check(CLI::IsMember({"420", "422", "444"}))
      ->capture_default_str();
  command
      .add_option(
          "--tune", a.tune,
          "off, or a PSNR in dB, e.g. 36: takes the quality and subsampling of fewest bytes that reach it on the "
          "model's pixels of a sample of " +
              std::to_string(kTuneFaces) + " images")
      ->capture_default_str();
  command.add_option("--tolerance", a.bake.tolerance_px, "largest projected error in the images, face pixels")
      ->check(CLI::Range(0.0F, 100.0F))
      ->capture_default_str();
  command.add_option("--supersampling", a.bake.supersampling, "n x n samples per face pixel")
      ->check(CLI::Range(1, 8))
      ->capture_default_str();
  command.add_option("--batch", a.bake.batch_faces, "images per commit: the most a killed build loses")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command
      .add_option("--light", a.light,
                  "unlit: colours as scanned; soft: a soft directional light; auto: unlit where the mesh has colours")
      ->check(CLI::IsMember({"auto", "unlit", "soft"}))
      ->capture_default_str();
  command.add_option("--up", a.up, "axis that points up in the first view")
      ->check(CLI::IsMember({"auto", "x", "y", "z"}))
      ->capture_default_str();
  command.add_option("--units", a.units, "unit of length of the mesh, e.g. m; kept in scene.json")
      ->capture_default_str();
  command.add_option("--voxel-triangles", a.hierarchy.voxel_triangles, "Nv: most triangles in a voxel")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  command.add_option("--leaf-triangles", a.hierarchy.leaf_triangles, "Nl: most triangles in a leaf patch")
      ->check(CLI::Range(16, 20'000))
      ->capture_default_str();
  command.add_option("--node-triangles", a.hierarchy.node_triangles, "Nn: most triangles in any other patch")
      ->check(CLI::Range(16, 20'000))
      ->capture_default_str();
  command
      .add_option("--position-bits", a.hierarchy.position_bits,
                  "lattice steps along the longest side, as a power of two, 10 to 21; 0: chosen from the mean edge")
      ->check(CLI::Range(0, 21))
      ->capture_default_str();
  command
      .add_option("--qsplat-dice", a.splats_dice,
                  "tree of splats from a mesh: edges longer than so many times what is usual around them are cut, so "
                  "that large triangles make no large splats; adds up to as many splats again; 0: none are")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  command.add_option("--threads", a.hierarchy.limits.threads, "0: all cores; the result does not depend on it")
      ->capture_default_str();
  command
      .add_option("--memory", a.hierarchy.limits.memory_bytes,
                  "most memory to use, e.g. 4G, at least 256M: of this process, and of those that draw images with it "
                  "together; 0: 60 % of the machine's; the result does not depend on it")
      ->transform(CLI::AsSizeValue(false))
      ->capture_default_str();
  command.add_option("--tmpdir", a.tmpdir,
                     "directory for work files, about 60 bytes per triangle; default: within the scene");
  command
      .add_option("--regroup", a.regroup,
                  "on: new groups of patches at each level; off: the paper's binary tree, whose locked borders pile up")
      ->check(CLI::IsMember({"on", "off"}))
      ->capture_default_str();
  command
      .add_option("--shard", a.shard,
                  "i/n: render only the i-th (0 to n-1) of n contiguous ranges of the grid, into a store of its own; "
                  "any number of such commands may run at a time, on one scene. auto: i and n from a Slurm job array "
                  "(times the rank within a task), an MPI launcher or srun. Default: all, or the rank where mpirun "
                  "started several")
      ->check([](const std::string& text) {
        const auto shard = repository::parseShard(text);
        return text == "auto" || shard ? std::string() : shard.error().message;
      });
  command
      .add_option("--shards", a.shards,
                  "divide the images into n stores and build all of them; 0: as the scene is divided, else one store")
      ->check(CLI::Range(std::uint32_t{0}, repository::kMaxShards))
      ->capture_default_str();
  command.add_flag("--missing", a.missing,
                   "build nothing; list what this command would still have to make. Status 0: nothing, 3: something, "
                   "1: it cannot be told");
  command.add_flag("--json", a.json, "summary as JSON");
  command.add_flag("--quiet", a.quiet, "no progress");
}

bool isGiven(const CLI::App& command, const std::string& option) {
  return command.get_option(option)->count() > 0;
}

// What is wrong with options that each are right; empty when nothing is. Sets tune_db.
std::string wrongUsage(const CLI::App& command, BuildArguments& a) {
  if (wants(a, "images") && !wants(a, "patch")) return "--methods images needs patch as well";
  if (!parseTune(a.tune, a.tune_db))
    return "--tune " + a.tune + ": give off, or a PSNR in dB above 0 and below 99, e.g. 36";
  if (a.tune_db && !wants(a, "images"))
    return "--tune chooses quality and subsampling of the images: leave out --tune, or build images";
  if (a.tune_db && (isGiven(command, "--quality") || isGiven(command, "--subsampling")))
    return "--tune chooses quality and subsampling of the images: leave out --quality and --subsampling, or --tune";
  if (a.bake.target_db <= 0.0 && (a.bake.budget_bytes != 0 || !a.refine_from.empty()))
    return "--budget and --refine-from are of adaptive sampling: give --target too";
  if (isAdaptive(a.bake) && (!a.shard.empty() || a.shards != 0)) return kAdaptiveIsWhole;
  if (a.bake.target_db > 0.0 && a.bake.demand_views > 0)
    return "--target splits cells, --views chooses points: give one of them";
  if (isGiven(command, "--qsplat-coded") && !wants(a, "qsplat"))
    return "--qsplat-coded is of the tree of splats: give --methods qsplat too";
  if (a.bake.demand_views == 0 && isGiven(command, "--worth")) return "--worth is of sampling by use: give --views too";
  return "";
}

// The recorded parameters but for those that the given options overrule: how images are encoded is either said or
// tuned.
Parameters recordedBeside(const CLI::App& given, const Parameters& parameters) {
  Parameters recorded = withoutChoice(parameters);
  if (recorded.contains("tune")) recorded.erase("subsampling");
  if (isGiven(given, "--quality") || isGiven(given, "--subsampling")) recorded.erase("tune");
  if (isGiven(given, "--tune") && given.get_option("--tune")->as<std::string>() != "off")
    for (const char* name : {"quality", "subsampling"}) recorded.erase(name);
  return recorded;
}

// A command without meshes: what it does not say is what the scene in its output records.
Result<BuildArguments> withRecordedOptions(const CLI::App& given, const BuildArguments& a) {
  const std::string finished = a.output + "/scene.json";
  const std::string building = a.output + "/" + base::kBuildingFile;
  const std::string file = fs::exists(finished) ? finished : building;
  if (!fs::exists(file) && a.missing) return a;
  if (!fs::exists(file))
    return Error{ErrorCode::kNotFound, a.output + ": no scene is here to go on with; give the meshes too"};
  LUMIGRID_ASSIGN_OR_RETURN(auto scene, base::readSceneFile(file));

  BuildArguments completed;
  CLI::App options;
  declareOptions(options, completed);
  std::vector<std::string> words;
  for (const CLI::Option* option : given.get_options())
    for (const std::string& value : option->results())
      if (!option->get_lnames().empty()) words.push_back("--" + option->get_lnames().front() + "=" + value);
  for (const auto& [name, value] : recordedBeside(given, scene.parameters)) {
    const CLI::Option* option = given.get_option_no_throw("--" + name);
    if (name != kShardsParameter && option != nullptr && option->count() == 0)
      words.push_back("--" + name + "=" + value);
  }
  try {
    options.parse(words);
  } catch (const CLI::ParseError& error) {
    return Error{ErrorCode::kInvalidInput, file + ": records an option that this program does not take: " +
                                               error.what() + "; build the scene again from its meshes"};
  }
  return completed;
}

}  // namespace

Run addDraw(CLI::App&) {
  return []() -> int {
    struct stat input {};
    if (::fstat(STDIN_FILENO, &input) != 0 || !S_ISSOCK(input.st_mode))
      return fail({ErrorCode::kInvalidInput, std::string(kDrawCommand) + " is what `lumigrid build` starts; use that"});
    return runDrawProcess(STDIN_FILENO);
  };
}

Run addBuild(CLI::App& command) {
  auto a = std::make_shared<BuildArguments>();
  declareOptions(command, *a);
  return [a, &command]() -> int {
    if (a->meshes.empty()) {
      auto completed = withRecordedOptions(command, *a);
      if (!completed) return fail(completed.error());
      *a = std::move(*completed);
    }
    if (const std::string wrong = wrongUsage(command, *a); !wrong.empty()) {
      std::fprintf(stderr, "lumigrid: %s\n", wrong.c_str());
      return kWrongUsage;
    }
    if (a->missing) {
      auto missing = findMissingParts(*a);
      return missing ? reportMissing(a->output, *missing, a->json) : fail(missing.error());
    }
    stopOnSignals();
    auto done = build(*a);
    return done ? kDone : fail(done.error());
  };
}

}  // namespace server::cli
