#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/file.h"
#include "base/json/annotations_file.h"
#include "lod/qsplat/splat_file.h"
#include "repository/access.h"
#include "repository/parameters.h"
#include "repository/repository.h"
#include "repository/verify.h"
#include "server/cmd/commands.h"
#include "server/cmd/console.h"
#include "server/cmd/scene_images.h"
#include "server/net/open_scene.h"

namespace server::cmd {
namespace {

namespace fs = std::filesystem;

struct VerifyArguments {
  std::string scene;
  bool json = false;
};

using Faults = std::vector<std::string>;

// Every part that scene.json lists is there, with its size and hash.
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
    auto hash = base::sha256OfFile(path);
    if (!hash)
      faults.push_back(hash.error().message);
    else if (*hash != part.sha256)
      faults.push_back(path + ": its SHA-256 is " + *hash + ", scene.json says " + part.sha256);
  }
}

void verifyPatches(const std::string& path, const base::Scene& scene, Faults& faults) {
  auto patches = lod::patch::PatchFile::open(path);
  if (!patches) {
    faults.push_back(patches.error().message);
    return;
  }
  for (const std::string& fault : patches->verify()) faults.push_back(fault);
  const lod::patch::Hierarchy& h = patches->hierarchy();
  if (h.has_colors != scene.has_colors) faults.push_back(path + ": colours do not agree with scene.json");
  base::Aabb box = scene.localBox();
  const float slack = static_cast<float>(h.lattice.positionError()) + 1e-6F * box.diagonal();
  box.min -= slack;
  box.max += slack;
  for (std::size_t i = 0; i < h.patches.size(); ++i)
    if (h.patches[i].level == 0 && !(box.contains(h.patches[i].box.min) && box.contains(h.patches[i].box.max)))
      faults.push_back(path + ": leaf patch " + std::to_string(i) + " lies outside the scene's box");
}

void verifySplats(const std::string& path, const base::Scene& scene, Faults& faults) {
  const auto splats = lod::qsplat::SplatFile::open(path);
  if (!splats) {
    faults.push_back(splats.error().message);
    return;
  }
  for (const std::string& fault : splats->verify()) faults.push_back(path + ": " + fault);
  const lod::qsplat::Header& header = splats->header();
  if (header.colors != scene.has_colors) faults.push_back(path + ": colours do not agree with scene.json");
  const base::Aabb box = scene.localBox();
  const float slack = header.root.radius + 1e-6F * box.diagonal();
  if (!base::Aabb{box.min - slack, box.max + slack}.contains(header.root.center))
    faults.push_back(path + ": its root lies outside the scene's box");
}

// The points that a store samples; nothing, and a fault, when it does not say.
std::optional<repository::SampledPoints> pointsOf(const repository::Store& store, const std::string& path,
                                                  Faults& faults) {
  auto meta = store.readMeta();
  if (!meta || !meta->has_value()) {
    faults.push_back(meta ? path + ": does not say which grid it belongs to" : meta.error().message);
    return std::nullopt;
  }
  auto points = repository::sampledPointsFromMeta(**meta, path);
  if (!points) {
    faults.push_back(points.error().message);
    return std::nullopt;
  }
  if (points->tree && !points->tree->openLeaves().empty())
    faults.push_back(path + ": of its cells " + std::to_string(points->tree->openLeaves().size()) +
                     " are still to be judged");
  return std::move(*points);
}

void verifyPacks(const std::string& directory, const std::string& index, Faults& faults) {
  auto packs = openPacks(directory, index);
  if (!packs) {
    faults.push_back(packs.error().message);
    return;
  }
  const auto points = pointsOf(**packs, directory + "/" + index, faults);
  if (!points) return;
  for (std::string& fault : repository::verify(**packs, points->grid, points->treeOrNull()))
    faults.push_back(std::move(fault));
}

// One store: the parameters are those of all, and so are its values.
void verifyStore(const std::string& path, const repository::Shard& shard, const std::string& meta,
                 const repository::Grid& grid, Faults& faults) {
  if (!repository::isLmdbStore(path) && repository::pointsOf(shard, grid).size() == 0) return;
  auto store = repository::openLmdbStore(path, repository::StoreMode::kRead);
  if (!store) {
    faults.push_back(store.error().message);
    return;
  }
  const auto points = pointsOf(**store, path, faults);
  if (!points) return;
  const std::string own = (*store)->readMeta()->value_or("");
  if (!repository::sameParameters(meta, own)) {
    faults.push_back(path +
                     ": was built with other parameters than other shards: " + repository::firstDifference(meta, own));
    return;
  }
  auto found = repository::verifyShard(**store, grid, shard, points->treeOrNull());
  if (!found)
    faults.push_back(found.error().message);
  else
    for (const std::string& fault : *found) faults.push_back(path + ": " + fault);
}

// The parameters of the first store that can be read; why others cannot be is told where they are looked at.
std::optional<std::string> firstMeta(const std::string& images, std::uint32_t shards) {
  for (std::uint32_t i = 0; i < std::max(shards, 1U); ++i) {
    auto store = repository::openLmdbStore(repository::storeDirectory(images, shards, i), repository::StoreMode::kRead);
    if (!store) continue;
    if (auto meta = (*store)->readMeta(); meta && meta->has_value()) return **meta;
  }
  return std::nullopt;
}

// Every store of the scene's division, and none besides.
void verifyImages(const std::string& images, const base::Scene& scene, Faults& faults) {
  auto shards = shardsOf(scene);
  auto orphans = shards ? orphanStores(images, *shards) : shards.error();
  if (!orphans) {
    faults.push_back(orphans.error().message);
    return;
  }
  for (const std::string& orphan : *orphans)
    faults.push_back(orphan + ": is not of this scene's division of the images");
  const auto meta = firstMeta(images, *shards);
  if (!meta) {
    faults.push_back(images + ": no store here says which grid it belongs to");
    return;
  }
  auto grid = repository::gridFromMeta(*meta, images);
  if (!grid) {
    faults.push_back(grid.error().message);
    return;
  }
  const std::uint32_t count = std::max(*shards, 1U);
  for (std::uint32_t i = 0; i < count; ++i)
    verifyStore(repository::storeDirectory(images, *shards, i), {i, count}, *meta, *grid, faults);
}

// Servers keep it; a scene has none until one was served.
void verifyAccess(const std::string& path, Faults& faults) {
  if (!fs::exists(path)) return;
  auto bytes = base::readFile(path);
  if (!bytes) {
    faults.push_back(bytes.error().message);
    return;
  }
  if (const auto file = repository::decodeAccess(*bytes); !file) faults.push_back(path + ": " + file.error().message);
}

void verifyAnnotations(const std::string& directory, Faults& faults) {
  if (auto notes = base::readAnnotations(directory); !notes) faults.push_back(notes.error().message);
}

int run(const VerifyArguments& a) {
  auto scene = base::readScene(a.scene);
  if (!scene) return fail(scene.error());
  Faults faults;
  verifyParts(a.scene, *scene, faults);
  const bool has_splats = base::partFile(*scene, "qsplat", ".lgq").has_value();
  if (has_splats) verifySplats(base::splatPath(a.scene, *scene), *scene, faults);
  if (!has_splats || base::partFile(*scene, "patch", ".lgp"))
    verifyPatches(base::patchPath(a.scene, *scene), *scene, faults);
  const auto index = base::partFile(*scene, "images/index", ".lgi");
  if (index)
    verifyPacks(a.scene, *index, faults);
  else if (fs::is_directory(a.scene + "/images"))
    verifyImages(a.scene + "/images", *scene, faults);
  verifyAccess(repository::accessFileOf(a.scene), faults);
  verifyAnnotations(a.scene, faults);

  if (a.json) {
    std::printf("%s\n", nlohmann::json{{"scene", a.scene}, {"faults", faults}}.dump(2).c_str());
  } else {
    for (const std::string& fault : faults) std::printf("%s\n", fault.c_str());
    if (faults.empty())
      std::printf("%s: all is well\n", a.scene.c_str());
    else if (index)
      std::printf("%s: %zu faults; `lumigrid publish` of the built scene with --rewrite mends them\n", a.scene.c_str(),
                  faults.size());
    else
      std::printf(
          "%s: %zu faults; `lumigrid build -o %s` renders missing and broken images again and removes what does not "
          "belong "
          "here, other parts need --force\n",
          a.scene.c_str(), faults.size(), a.scene.c_str());
  }
  return faults.empty() ? kDone : kFailed;
}

}  // namespace

Run addVerify(CLI::App& command) {
  auto a = std::make_shared<VerifyArguments>();
  command.add_option("SCENE", a->scene, "scene directory")->required();
  command.add_flag("--json", a->json, "faults as JSON");
  return [a] { return run(*a); };
}

}  // namespace server::cmd
