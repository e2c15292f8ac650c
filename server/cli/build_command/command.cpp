// lumigrid build makes a scene: hierarchy, tree of splats, points with umbrellas, octree of triangles and points,
// images, one after the other, each resumable.
//
// Any number of processes may work on one scene. Steps that concern the whole scene run under its lock
// (SceneLock): making or opening it with its hierarchy, the choices made once for all images, and declaring it
// finished. Before the last one each process renders its shards, each under the lock of the shard's store. The process
// that finds nothing missing writes scene.json.
#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <utility>

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"
#include "mesh/stream_mesh.h"
#include "server/bake/draw_processes.h"
#include "server/cli/auto_choice.h"
#include "server/cli/build_command/build_record.h"
#include "server/cli/build_command/images.h"
#include "server/cli/build_command/methods.h"
#include "server/cli/build_command/options.h"
#include "server/cli/build_command/report.h"
#include "server/cli/build_command/resume.h"
#include "server/cli/commands.h"
#include "server/cli/console.h"
#include "server/cli/scene_images.h"
#include "server/cli/scene_lock.h"
#include "server/cli/scene_sources.h"

namespace server::cli {
namespace {

namespace fs = std::filesystem;
using base::Result;

Result<SceneLock> lockScene(const BuildArguments& a) {
  return SceneLock::acquire(a.output, [&](const std::string& holder) {
    if (!a.quiet)
      std::fprintf(stderr, "lumigrid: waiting for %s, which is preparing %s\n", holder.c_str(), a.output.c_str());
  });
}

/// Finds or makes the scene with its hierarchies. Under the scene's lock.
Result<BuildOutput> prepareScene(const BuildArguments& a, const SceneSources& sources, ShardSelection& selection,
                                 BuildReport& report, ProgressLine& line) {
  LUMIGRID_ASSIGN_OR_RETURN(auto output, openOutput(a, sources));
  const auto lacks = [&](const FileMethod& method) {
    return output.scene ? lacksFile(a, *output.scene, method) : wants(a, method.method);
  };
  if (lacks(kUmbrellas)) LUMIGRID_TRY(needUmbrellaBuilder());
  if (a.force) {
    LUMIGRID_TRY(needMeshes(a, "hierarchy"));
    LUMIGRID_TRY(removeScene(a.output));
  }
  const auto shared = shareSource(a, sources, lacks);
  const MethodBuilds builds{a, sources, shared.get(), report, line};
  using BuildMethod = Result<void> (*)(const MethodBuilds&, std::optional<base::Scene>&);
  const std::pair<FileMethod, BuildMethod> methods[] = {
      {kPatches, buildPatches}, {kSplats, buildSplats}, {kUmbrellas, buildUmbrellas}, {kHlod, buildHlod}};
  for (const auto& [method, buildMethod] : methods) {
    if (!lacks(method)) continue;
    LUMIGRID_TRY(buildMethod(builds, output.scene));
    LUMIGRID_TRY(recordMethods(a, output));
  }
  removeSharedSource(a, shared.get());
  LUMIGRID_TRY(settleDivision(a, output, selection));
  return output;
}

/// Whether the command leaves open what is built. With --methods auto, or without --methods, a cloud of points gets
/// what can be made of it.
bool mayLeaveOutPatches(const BuildArguments& a) {
  return a.automatic || a.usual_methods;
}

/// Leaves out what needs triangles, which a cloud of points has none of.
void leaveOutPatches(BuildArguments& a) {
  std::erase_if(a.methods, [](const std::string& method) { return method == "patch" || method == "images"; });
  if (a.methods.empty()) a.methods = {"qsplat"};
  a.automatic = a.usual_methods = false;
}

bool isForLackOfFaces(const base::Error& error) {
  return error.code == base::ErrorCode::kUnsupported && error.message.ends_with(mesh::kOnlyPoints);
}

/// prepareScene(), again without patches where there turn out to be no faces.
Result<BuildOutput> prepareWhatCanBe(BuildArguments& a, const SceneSources& sources, ShardSelection& selection,
                                     BuildReport& report, ProgressLine& line) {
  auto prepared = prepareScene(a, sources, selection, report, line);
  if (prepared || !mayLeaveOutPatches(a) || !isForLackOfFaces(prepared.error())) return prepared;
  leaveOutPatches(a);
  if (!a.quiet) {
    const std::string methods = listMethods([&](const char* method) { return wants(a, method); });
    std::fprintf(stderr, "points without faces, so only %s is built\n", methods.c_str());
  }
  return prepareScene(a, sources, selection, report, line);
}

/// Adds images to the command's methods.
Result<void> addImages(BuildArguments& a, const SceneSources& sources, BuildOutput& output) {
  a.methods.emplace_back("images");
  a.force = false;  // what was there is gone already
  LUMIGRID_ASSIGN_OR_RETURN(output, openOutput(a, sources));
  return {};
}

/// For --methods auto: adds images to the command's methods, where they pay. Under the scene's lock.
Result<void> settleMethods(BuildArguments& a, const SceneSources& sources, BuildOutput& output, BuildReport& report,
                           ProgressLine& line) {
  LUMIGRID_ASSIGN_OR_RETURN(report.trial, chooseMethods(a, output, line));
  if (!a.quiet) std::fprintf(stderr, "auto: %s\n", describeTrial(*report.trial).c_str());
  return report.trial->imagesPay() ? addImages(a, sources, output) : Result<void>();
}

/// Makes the choices that all images share, and writes building.json as it should be. Under the scene's lock.
Result<ImageChoices> prepareImages(const BuildArguments& a, BuildOutput& output, const ShardSelection& selection,
                                   BuildReport& report, ProgressLine& line) {
  ImageChoices choices;
  if (wants(a, "images")) {
    LUMIGRID_TRY(removeOrphanStores(a, selection.shards));
    LUMIGRID_ASSIGN_OR_RETURN(choices, makeImageChoices(a, output, line));
    LUMIGRID_TRY(removeImagesOfOtherLight(a, selection.shards, *output.scene));
    report.tuned = choices.tuned;
  }
  if (output.finished) return choices;
  if (selection.shards != 0) output.scene->parameters[kShardsParameter] = std::to_string(selection.shards);
  LUMIGRID_TRY(recordScene(a, output));
  std::error_code ignored;
  fs::remove(fs::path(a.output) / "scene.json", ignored);  // a scene that gets images is unfinished again
  return choices;
}

/// Writes scene.json, if nothing is missing. Under the scene's lock.
Result<void> declareFinished(const BuildArguments& a, BuildOutput& output, const ShardSelection& selection,
                             BuildReport& report) {
  base::Scene& scene = *output.scene;
  if (hasMethod(scene.parameters, "images") && !wants(a, "images")) return {};  // another command is at them
  if (hasMethod(scene.parameters, "images")) {
    LUMIGRID_ASSIGN_OR_RETURN(report.missing, findMissingImages(a, scene, selection.shards));
    if (!report.missing.empty()) return {};
  }
  if (!fs::exists(fs::path(a.output) / "scene.json")) {
    if (hasMethod(scene.parameters, "images") && !hasPart(scene, "images")) scene.parts.push_back({"images", 0, ""});
    LUMIGRID_TRY(base::writeSceneFile(scene, a.output + "/scene.json"));
  }
  std::error_code ignored;
  fs::remove(fs::path(a.output) / base::kBuildingFile, ignored);
  // Runs that were killed while they wrote these files left pieces of them.
  for (const char* name : kWholeFiles) base::removeUnfinished(a.output + "/" + name);
  return {};
}

/// A model of flat colours whose patches all reach a viewer within seconds may need no images, which take far longer to
/// make: says how to find out, where the user did not ask for them.
void adviseTrial(const BuildArguments& a, const BuildOutput& output) {
  constexpr std::uintmax_t kSmall = 4'000'000;  // bytes: 2 seconds of 20 Mbit/s. A choice.
  if (a.quiet || !a.usual_methods || hasPart(*output.scene, kTextureFile)) return;
  std::error_code error;
  const std::uintmax_t bytes = fs::file_size(fs::path(a.output) / kPatches.file, error);
  if (error || bytes > kSmall) return;
  std::fprintf(stderr,
               "images: all patches together are %s; `--methods auto` makes images only where a few views are better "
               "with them\n",
               formatBytes(bytes).c_str());
}

Result<void> build(BuildArguments a) {
  base::keepFreedMemory();
  LUMIGRID_ASSIGN_OR_RETURN(auto selection, shardSelectionOf(a));
  if (a.force && selection.index)
    return base::Error{
        base::ErrorCode::kInvalidInput,
        "--force would remove what other shards made; make the hierarchy anew first: --methods patch --force"};
  const SceneSources sources(a.meshes, true);
  LUMIGRID_TRY(sources.check());
  ProgressLine line(a.quiet);
  BuildReport report;
  BuildOutput output;
  ImageChoices choices;
  {
    LUMIGRID_ASSIGN_OR_RETURN(const auto lock, lockScene(a));
    LUMIGRID_ASSIGN_OR_RETURN(output, prepareWhatCanBe(a, sources, selection, report, line));
    if (a.automatic) LUMIGRID_TRY(settleMethods(a, sources, output, report, line));
    LUMIGRID_ASSIGN_OR_RETURN(choices, prepareImages(a, output, selection, report, line));
  }
  if (wants(a, "images")) {
    adviseTrial(a, output);
    LUMIGRID_TRY(buildImages(a, output, choices, selection, report, line));
  }
  {
    LUMIGRID_ASSIGN_OR_RETURN(const auto lock, lockScene(a));
    LUMIGRID_TRY(declareFinished(a, output, selection, report));
    LUMIGRID_TRY(addToBuildRecord(a.output, report));
  }
  printReport(a, output, report);
  return {};
}

/// For --methods auto: adds images to the command's methods where an earlier run found that they pay. False where none
/// has measured it.
Result<bool> settleRecordedMethods(BuildArguments& a, const SceneSources& sources, BuildOutput& output) {
  if (!output.scene) return false;
  LUMIGRID_ASSIGN_OR_RETURN(const auto trial, storedTrial(output.scene->parameters));
  if (!trial) return false;
  if (trial->imagesPay()) LUMIGRID_TRY(addImages(a, sources, output));
  return true;
}

/// Finds the parts that the same command would still have to make (`build --missing`). Cheap, so that it can be asked
/// often: sources are known by their sizes, images by their keys.
Result<MissingParts> findMissingParts(BuildArguments a) {
  LUMIGRID_ASSIGN_OR_RETURN(auto selection, shardSelectionOf(a));
  const SceneSources sources(a.meshes, false);
  LUMIGRID_TRY(sources.check());
  LUMIGRID_ASSIGN_OR_RETURN(auto output, openOutput(a, sources));
  const bool is_cloud = output.scene && output.scene->triangles == 0 && lacksFile(a, *output.scene, kPatches);
  if (is_cloud && mayLeaveOutPatches(a)) leaveOutPatches(a);
  MissingParts missing;
  missing.shards = selection.shards;
  if (a.automatic) {
    LUMIGRID_ASSIGN_OR_RETURN(const bool settled, settleRecordedMethods(a, sources, output));
    missing.methods = !settled;
  }
  if (!output.scene) {
    missing.hierarchy = wants(a, "patch");
    missing.splats = wants(a, "qsplat");
    missing.umbrellas = wants(a, "pmr");
    missing.hlod = wants(a, "hlod");
    return missing;
  }

  const base::Scene& scene = *output.scene;
  LUMIGRID_TRY(settleDivision(a, output, selection));
  missing.shards = selection.shards;
  missing.hierarchy = lacksFile(a, scene, kPatches);
  missing.splats = lacksFile(a, scene, kSplats);
  missing.umbrellas = lacksFile(a, scene, kUmbrellas);
  missing.hlod = lacksFile(a, scene, kHlod);
  if (!wants(a, "images")) {
    missing.declaration = !missing.files() && !output.finished && !hasMethod(scene.parameters, "images");
    return missing;
  }
  missing.images_light = scene.images_light;
  LUMIGRID_ASSIGN_OR_RETURN(missing.images, findMissingImages(a, scene, selection.shards, &missing.points));
  if (selection.index)
    std::erase_if(missing.images, [&](const auto& one) { return one.shard.index != *selection.index; });
  missing.declaration = !missing.files() && !output.finished && missing.images.empty() && !selection.index;
  return missing;
}

}  // namespace

RunCommand addBuild(CLI::App& command) {
  auto a = std::make_shared<BuildArguments>();
  declareBuildOptions(command, *a);
  return [a, &command]() -> int {
    if (a->meshes.empty()) {
      auto completed = withRecordedOptions(command, *a);
      if (!completed) return fail(completed.error());
      *a = std::move(*completed);
    }
    if (const std::string wrong = usageError(command, *a); !wrong.empty()) {
      std::fprintf(stderr, "lumigrid: %s\n", wrong.c_str());
      return kWrongUsage;
    }
    if (a->missing) {
      auto missing = findMissingParts(*a);
      return missing ? reportMissing(a->output, *missing, a->json) : fail(missing.error());
    }
    stopOnSignals();
    ignoreBrokenPipes();
    return exitStatus(build(*a));
  };
}

RunCommand addDraw(CLI::App&) {
  return []() -> int {
    struct stat input {};
    if (::fstat(STDIN_FILENO, &input) != 0 || !S_ISSOCK(input.st_mode))
      return fail(
          {base::ErrorCode::kInvalidInput, std::string(kDrawCommand) + " is what `lumigrid build` starts; use that"});
    return runDrawProcess(STDIN_FILENO);
  };
}

}  // namespace server::cli
