#include "server/cli/build_command/resume.h"

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <nlohmann/json.hpp>

#include "base/file.h"
#include "repository/repository.h"
#include "repository/store.h"
#include "server/cli/auto_choice.h"
#include "server/cli/build_command/build_record.h"
#include "server/cli/scene_images.h"
#include "server/cli/scene_lock.h"

namespace server::cli {
namespace {

namespace fs = std::filesystem;
using base::Error;
using base::ErrorCode;
using base::Result;

/// How a scene that is there fits a command.
enum class Fit {
  kSame,  ///< it is what the command makes, or more, but for methods with a file, which are added to any scene
  kMore,  ///< it has the hierarchy that images need; there are none yet, or none asked for, so they may differ
  kOther
};

// A source whose hash was not worked out is known by its size.
bool sameSources(const std::vector<base::SceneSource>& a, const std::vector<base::SceneSource>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const auto& x, const auto& y) {
    return x.bytes == y.bytes && (x.sha256 == y.sha256 || x.sha256.empty() || y.sha256.empty());
  });
}

bool sameHierarchies(const BuildArguments& a, Parameters recorded, Parameters wanted) {
  for (const char* name : kSourceParameters)
    if (recorded[name] != wanted[name]) return false;
  if (wants(a, "patch") && hasMethod(recorded, "patch"))
    for (const char* name : kHierarchyParameters)
      if (recorded[name] != wanted.at(name)) return false;
  if (recorded.contains(kTexturesParameter) != wanted.contains(kTexturesParameter)) return false;
  const auto isIn = [&](const char* method) { return hasMethod(recorded, method); };
  const auto isWanted = [&](const char* method) { return wants(a, method); };
  for (const auto& [name, methods] : kSharedParameters)
    if (std::any_of(methods.begin(), methods.end(), isIn) && std::any_of(methods.begin(), methods.end(), isWanted) &&
        recorded[name] != wanted.at(name))
      return false;
  for (const auto& [method, name] : kMethodParameters)
    if (isWanted(method) && isIn(method) && recorded[name] != wanted.at(name)) return false;
  return !isWanted("qsplat") || !isIn("qsplat") || recorded.contains(kSplatsCoded) == a.splats_coded;
}

Fit fitOf(const BuildArguments& a, const std::vector<base::SceneSource>& sources, const base::Scene& scene,
          bool has_images) {
  if (!a.meshes.empty() && !sameSources(scene.sources, sources)) return Fit::kOther;
  Parameters recorded = withoutChoice(scene.parameters);
  recorded.erase(kShardsParameter);
  recorded.try_emplace("stitch", "off");        // scenes of programs that did not stitch
  recorded.try_emplace("codec", "jpeg");        // or knew no other codec
  recorded.try_emplace("normals", "vertices");  // or stored all normals
  Parameters wanted = parametersOf(a);
  // Earlier programs recorded grid and margin also where they were not given.
  for (Parameters* parameters : {&recorded, &wanted}) {
    parameters->try_emplace("grid", nlohmann::json(usualGrid(scene)).dump());
    parameters->try_emplace("margin", nlohmann::json(usualMargin(scene)).dump());
  }
  if (!sameHierarchies(a, recorded, wanted)) return Fit::kOther;
  if (!wants(a, "images")) return Fit::kSame;
  if (!hasMethod(scene.parameters, "images")) return Fit::kMore;
  for (Parameters* parameters : {&recorded, &wanted}) {
    for (const char* name : {"methods", kSplatsCoded, kAutoParameter}) parameters->erase(name);
    for (const MethodParameter& parameter : kMethodParameters) parameters->erase(parameter.name);
  }
  if (recorded == wanted) return Fit::kSame;
  return !has_images && withoutEncoding(recorded) == withoutEncoding(wanted) ? Fit::kMore : Fit::kOther;
}

// Adds the methods that a scene has to those that a command wants.
void addMethods(const Parameters& recorded, Parameters& wanted) {
  for (const char* name : {kSplatsCoded, kAutoParameter})
    if (recorded.contains(name)) wanted[name] = recorded.at(name);
  wanted["methods"] =
      listMethods([&](const char* method) { return hasMethod(recorded, method) || hasMethod(wanted, method); });
  for (const MethodParameter& parameter : kMethodParameters)
    if (const auto it = recorded.find(parameter.name); it != recorded.end()) wanted.insert(*it);
}

// The command's options; the scene's methods and division stay.
void adoptParameters(const BuildArguments& a, base::Scene& scene) {
  Parameters parameters = parametersOf(a);
  addMethods(scene.parameters, parameters);
  if (const auto it = scene.parameters.find(kShardsParameter); it != scene.parameters.end()) parameters.insert(*it);
  scene.parameters = std::move(parameters);
}

bool isPublished(const base::Scene& scene) {
  return std::any_of(scene.parts.begin(), scene.parts.end(),
                     [](const base::ScenePart& part) { return base::isPublishedName(part.file); });
}

Result<BuildOutput> goOnWith(const BuildArguments& a, const SceneSources& sources, base::Scene scene, bool finished) {
  if (isPublished(scene))
    return Error{ErrorCode::kExists, a.output +
                                         ": is a published scene; build the one that it was published from, and "
                                         "publish that again"};
  LUMIGRID_ASSIGN_OR_RETURN(const auto layout, repository::layoutOf(a.output + "/images"));
  const bool has_images = finished || layout.undivided || !layout.shards.empty();
  LUMIGRID_ASSIGN_OR_RETURN(const auto list, sources.all());
  const Fit fit = fitOf(a, list, scene, has_images);
  if (fit == Fit::kOther && finished)
    return Error{ErrorCode::kExists, a.output +
                                         ": holds a finished scene of other meshes or options already; choose another "
                                         "output, or say --force to build it again"};
  if (fit == Fit::kOther)
    return Error{
        ErrorCode::kExists,
        a.output +
            ": holds an unfinished build of other meshes or options; repeat those, or say --force to start afresh"};
  if (fit == Fit::kMore) adoptParameters(a, scene);
  const bool is_relit = scene.images_light && wants(a, "images");
  return BuildOutput{std::move(scene), finished && fit == Fit::kSame && !is_relit, ""};
}

// A build that was stopped on the way has left its work files, or a file that nothing lists yet.
bool isLeftByBuild(const std::string& name) {
  const bool of_method = std::any_of(std::begin(kFileMethods), std::end(kFileMethods), [&](const FileMethod& method) {
    return name == method.file || name == method.work_files;
  });
  return of_method || name == kLockFile || name == kSourceWorkFiles ||
         std::any_of(std::begin(kWholeFiles), std::end(kWholeFiles),
                     [&](const char* whole) { return name == whole || base::isUnfinished(name, whole); });
}

std::string documentOf(const BuildArguments& a, bool finished) {
  return a.output + "/" + (finished ? "scene.json" : base::kBuildingFile);
}

// Listed, and there with the size that is listed.
bool hasFile(const BuildArguments& a, const base::Scene& scene, const FileMethod& method) {
  return std::any_of(scene.parts.begin(), scene.parts.end(), [&](const base::ScenePart& part) {
    std::error_code error;
    return part.file == method.file && fs::file_size(fs::path(a.output) / part.file, error) == part.bytes;
  });
}

}  // namespace

Result<BuildOutput> openOutput(const BuildArguments& a, const SceneSources& sources) {
  if (a.force || !fs::exists(a.output)) return BuildOutput();
  if (!fs::is_directory(a.output))
    return Error{ErrorCode::kExists, a.output + ": is a file, not a scene directory; choose another output"};
  const bool finished = fs::exists(documentOf(a, true));
  if (fs::exists(documentOf(a, finished))) {
    LUMIGRID_ASSIGN_OR_RETURN(auto scene, base::readSceneFile(documentOf(a, finished)));
    return goOnWith(a, sources, std::move(scene), finished);
  }
  for (const auto& entry : fs::directory_iterator(a.output))
    if (!isLeftByBuild(entry.path().filename().string()))
      return Error{ErrorCode::kExists,
                   a.output + ": is not empty and not a scene; choose another output, or say --force"};
  return BuildOutput();
}

namespace {

Result<void> removePart(const std::string& directory, const std::string& name) {
  std::error_code error;
  fs::remove_all(fs::path(directory) / name, error);
  if (error) return Error{ErrorCode::kIo, directory + "/" + name + ": cannot remove: " + error.message()};
  return {};
}

// The scene's, and those that servers kept of scenes which lay here before.
bool holdsAccessCounts(const std::string& name) {
  return name == "access.lga" || (name.starts_with("access-") && name.ends_with(".lga"));
}

}  // namespace

Result<void> removeScene(const std::string& directory) {
  const std::string images = directory + "/images";
  LUMIGRID_ASSIGN_OR_RETURN(auto layout, repository::layoutOf(images));
  for (const repository::Shard& shard : layout.shards)
    LUMIGRID_TRY(repository::removeLmdbStore(repository::storeDirectory(images, shard.count, shard.index)));
  if (layout.undivided) LUMIGRID_TRY(repository::removeLmdbStore(images));
  for (const char* name : {"scene.json", base::kBuildingFile, kPatches.file, kPatches.work_files, kTextureFile,
                           kSplats.file, kSplats.work_files, kUmbrellas.file, kUmbrellas.work_files, kHlod.file,
                           kHlod.work_files, kSourceWorkFiles, "images", "access.lga.lock", kBuildRecord})
    LUMIGRID_TRY(removePart(directory, name));
  std::vector<std::string> counts;
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(directory, ignored))
    if (const std::string name = entry.path().filename().string(); holdsAccessCounts(name)) counts.push_back(name);
  for (const std::string& name : counts) LUMIGRID_TRY(removePart(directory, name));
  return {};
}

Result<void> recordScene(const BuildArguments& a, BuildOutput& output) {
  const std::string text = base::formatScene(*output.scene);
  if (text == output.recorded) return {};
  LUMIGRID_TRY(base::writeSceneFile(*output.scene, documentOf(a, output.finished)));
  output.recorded = text;
  return {};
}

Result<void> recordMethods(const BuildArguments& a, BuildOutput& output) {
  addMethods(parametersOf(a), output.scene->parameters);
  return recordScene(a, output);
}

bool hasPart(const base::Scene& scene, const std::string& file) {
  return std::any_of(scene.parts.begin(), scene.parts.end(),
                     [&](const base::ScenePart& part) { return part.file == file; });
}

bool lacksFile(const BuildArguments& a, const base::Scene& scene, const FileMethod& method) {
  return wants(a, method.method) && !hasFile(a, scene, method);
}

}  // namespace server::cli
