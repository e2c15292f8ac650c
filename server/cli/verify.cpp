#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/file.h"
#include "base/json/annotations_file.h"
#include "repository/access.h"
#include "repository/objects/open_objects.h"
#include "repository/repository.h"
#include "repository/sampling/expected_points.h"
#include "repository/sampling/parameters.h"
#include "repository/verify.h"
#include "server/cli/commands.h"
#include "server/cli/console.h"
#include "server/cli/scene_images.h"
#include "server/cli/verify_cuts.h"
#include "server/cli/verify_far.h"
#include "server/cli/verify_parts.h"
#include "server/net/open_scene.h"

namespace server::cli {
namespace {

namespace fs = std::filesystem;

struct VerifyArguments {
  std::string scene;
  bool json = false, quiet = false;
  std::uint32_t cuts = 0;  ///< 0: none are checked
  std::uint64_t seed = 1;
};

// Checks that every part that scene.json lists is there, with its size and hash.
void verifyParts(const std::string& directory, const base::Scene& scene, Faults& faults) {
  for (const base::ScenePart& part : scene.parts) {
    if (!repository::isObjectName(part.file)) {
      faults.push_back(directory + ": scene.json lists a part '" + part.file + "', which cannot be");
      continue;
    }
    const std::string path = directory + "/" + part.file;
    if (!fs::exists(path)) {
      faults.push_back(path + ": is missing, but scene.json lists it");
      continue;
    }
    if (fs::is_directory(path)) continue;
    if (fs::file_size(path) != part.bytes)
      faults.push_back(path + ": has " + std::to_string(fs::file_size(path)) + " bytes, scene.json says " +
                       std::to_string(part.bytes));
    const auto hash = valueOrFault(base::sha256OfFile(path), faults);
    if (hash && *hash != part.sha256)
      faults.push_back(path + ": its SHA-256 is " + *hash + ", scene.json says " + part.sha256);
  }
}

void verifyLocalPacks(const std::string& directory, const std::string& index, const VerifyProgress& progress,
                      Faults& faults) {
  if (const auto packs = valueOrFault(openPacks(directory, index), faults))
    verifyPacks(**packs, directory + "/" + index, progress, faults);
}

// Checks one store, whose parameters must be those of all others.
void verifyStore(const std::string& path, const repository::Shard& shard, const std::string& meta,
                 const repository::SampledPoints& points, Faults& faults) {
  const bool is_empty = repository::ExpectedPoints(points.grid, shard, points.treeOrNull()).size() == 0;
  if (is_empty && !repository::isLmdbStore(path)) return;
  const auto store = repository::openLmdbStore(path, repository::StoreMode::kRead);
  const auto own = valueOrFault(store ? (*store)->readMeta() : store.error(), faults);
  if (!own) return;
  if (!own->has_value()) return faults.push_back(path + ": does not say which grid it belongs to");
  if (*own != meta)
    return faults.push_back(
        path + ": was built with other parameters than other shards: " + repository::firstDifference(meta, **own));
  const auto found = valueOrFault(repository::verifyShard(**store, points.grid, shard, points.treeOrNull()), faults);
  for (const std::string& fault : found.value_or(Faults())) faults.push_back(path + ": " + fault);
}

// The parameters of the first store that can be read. verifyStore says why others cannot be.
std::optional<std::string> firstMeta(const std::string& images, std::uint32_t shards) {
  for (std::uint32_t i = 0; i < std::max(shards, 1U); ++i) {
    auto store = repository::openLmdbStore(repository::storeDirectory(images, shards, i), repository::StoreMode::kRead);
    if (!store) continue;
    if (auto meta = (*store)->readMeta(); meta && meta->has_value()) return **meta;
  }
  return std::nullopt;
}

// Checks every store of the scene's division, and that there are no others.
void verifyImages(const std::string& images, const base::Scene& scene, Faults& faults) {
  auto shards = shardsOf(scene);
  const auto orphans = valueOrFault(shards ? orphanStores(images, *shards) : shards.error(), faults);
  if (!orphans) return;
  for (const std::string& orphan : *orphans)
    faults.push_back(orphan + ": is not of this scene's division of the images");
  const auto meta = firstMeta(images, *shards);
  if (!meta) return faults.push_back(images + ": no store here says which grid it belongs to");
  const auto points = valueOrFault(repository::sampledPointsFromMeta(*meta, images), faults);
  if (!points) return;
  const std::uint32_t count = std::max(*shards, 1U);
  for (std::uint32_t i = 0; i < count; ++i)
    verifyStore(repository::storeDirectory(images, *shards, i), {i, count}, *meta, *points, faults);
}

// Servers write the file: a scene has none until it was served.
void verifyAccess(const std::string& path, Faults& faults) {
  if (!fs::exists(path)) return;
  const auto bytes = valueOrFault(base::readFile(path), faults);
  if (!bytes) return;
  if (const auto file = repository::decodeAccess(*bytes); !file) faults.push_back(path + ": " + file.error().message);
}

// Lists the faults of a scene on the disk.
base::Result<Faults> verifyHere(const std::string& directory, const VerifyProgress& progress, bool& is_published) {
  LUMIGRID_ASSIGN_OR_RETURN(auto scene, base::readScene(directory));
  Faults faults;
  verifyParts(directory, scene, faults);
  const bool has_splats = base::partFile(scene, "qsplat", ".lgq").has_value();
  if (has_splats) verifySplats(base::splatPath(directory, scene), scene, faults);
  if (!has_splats || base::partFile(scene, "patch", ".lgp"))
    verifyPatches(base::patchPath(directory, scene), scene, faults);
  const auto index = base::partFile(scene, "images/index", ".lgi");
  is_published = index.has_value();
  if (index)
    verifyLocalPacks(directory, *index, progress, faults);
  else if (fs::is_directory(directory + "/images"))
    verifyImages(directory + "/images", scene, faults);
  verifyAccess(repository::accessFileOf(directory), faults);
  valueOrFault(base::readAnnotations(directory), faults);
  return faults;
}

int run(const VerifyArguments& a) {
  stopOnSignals();
  ProgressLine line(a.quiet);
  const VerifyProgress progress = [&](double done) {
    line.show("verify", done);
    return !stopRequested();
  };
  bool is_published = repository::isRemotePlace(a.scene);
  if (a.cuts > 0 && is_published)
    return fail({base::ErrorCode::kInvalidInput, "--cuts needs the directory of a scene, not a place on a network"});
  auto faults = is_published ? verifyFar(a.scene, progress) : verifyHere(a.scene, progress, is_published);
  std::optional<CutReport> cuts;
  if (faults && a.cuts > 0 && !stopRequested()) {
    auto report = verifyCutsOfScene(a.scene, a.cuts, a.seed, progress);
    if (report) {
      faults->insert(faults->end(), report->faults.begin(), report->faults.end());
      cuts = std::move(*report);
    } else if (report.error().code != base::ErrorCode::kCancelled) {
      faults->push_back(report.error().message);
    }
  }
  line.finish();
  if (!faults) return fail(faults.error());
  if (stopRequested()) return fail({base::ErrorCode::kCancelled, "stopped before everything was read"});
  if (a.json) {
    nlohmann::json report{{"scene", a.scene}, {"faults", *faults}};
    if (cuts) report["cuts"] = cutsAsJson(*cuts);
    std::printf("%s\n", report.dump(2).c_str());
  } else {
    if (cuts) std::printf("%s", cutsAsText(*cuts).c_str());
    for (const std::string& fault : *faults) std::printf("%s\n", fault.c_str());
    if (faults->empty())
      std::printf("%s: all is well\n", a.scene.c_str());
    else if (is_published)
      std::printf("%s: %zu faults; `lumigrid publish` of the built scene with --rewrite mends them\n", a.scene.c_str(),
                  faults->size());
    else
      std::printf(
          "%s: %zu faults; `lumigrid build -o %s` renders missing and broken images again and removes what does not "
          "belong here, other parts need --force\n",
          a.scene.c_str(), faults->size(), a.scene.c_str());
  }
  return faults->empty() ? kDone : kFailed;
}

}  // namespace

RunCommand addVerify(CLI::App& command) {
  auto a = std::make_shared<VerifyArguments>();
  command
      .add_option("SCENE", a->scene,
                  "scene directory, or where a published scene lies: https://host/scene or s3://bucket/scene, which is "
                  "read by ranges, several at a time, without a cache")
      ->required();
  command.add_flag("--json", a->json, "faults as JSON");
  command.add_flag("--quiet", a->quiet, "no progress");
  command
      .add_option(
          "--cuts", a->cuts,
          "also rebuild this many random cuts of the patch hierarchy as half-edge meshes, and compare open edges, "
          "non-manifold vertices and orientation with the source's; needs some 200 bytes of memory a triangle")
      ->check(CLI::Range(0U, 1'000'000U))
      ->default_str("");
  command.add_option("--seed", a->seed, "the same seed gives the same cuts");
  return [a] { return run(*a); };
}

}  // namespace server::cli
