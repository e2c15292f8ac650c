#include "server/cli/scene_images.h"

#include <cstdio>
#include <nlohmann/json.hpp>
#include <sstream>

#include "server/cli/console.h"

namespace server::cli {
namespace {

constexpr std::size_t kMaxPrintedGaps = 10;  // gaps of each shard, for people; JSON has all

std::string placeOf(const repository::FaceKey& key) {
  std::ostringstream name;
  name << '(' << key.x << ", " << key.y << ", " << key.z << ", " << key.d << ')';
  return name.str();
}

std::uint64_t facesOf(const MissingParts& missing) {
  std::uint64_t faces = 0;
  for (const repository::ShardGaps& shard : missing.images) faces += shard.faces;
  return faces;
}

nlohmann::json toJson(const repository::FaceKey& key) {
  return {key.x, key.y, key.z, key.d};
}

void printJson(const std::string& scene, const MissingParts& missing) {
  nlohmann::json j{{"scene", scene},
                   {"complete", !missing.any()},
                   {"hierarchy", missing.hierarchy ? "missing" : "complete"},
                   {"scene_json", missing.any() ? "missing" : "complete"},
                   {"shards", missing.shards},
                   {"missing_faces", facesOf(missing)},
                   {"missing_shards", missing.shards == 0 ? "" : arrayOf(missing.images)},
                   {"missing", nlohmann::json::array()}};
  if (missing.splats) j["qsplat"] = "missing";
  if (missing.umbrellas) j["pmr"] = "missing";
  if (missing.hlod) j["hlod"] = "missing";
  if (missing.methods) j["methods"] = "missing";
  if (missing.points) j["sampling_points"] = "missing";
  if (missing.images_light) j["images_light"] = base::nameOf(missing.images_light->mode);
  for (const repository::ShardGaps& shard : missing.images) {
    nlohmann::json gaps = nlohmann::json::array();
    for (const repository::Gap& gap : shard.gaps)
      gaps.push_back({{"first", toJson(gap.first)}, {"last", toJson(gap.last)}, {"faces", gap.faces}});
    j["missing"].push_back({{"shard", shard.shard.index},
                            {"faces", shard.faces},
                            {"being_written", shard.being_written},
                            {"ranges", gaps}});
  }
  std::printf("%s\n", j.dump().c_str());
}

void printText(const std::string& scene, const MissingParts& missing) {
  if (!missing.any()) std::printf("%s: nothing is missing\n", scene.c_str());
  if (missing.hierarchy) std::printf("hierarchy: missing\n");
  if (missing.splats) std::printf("tree of splats: missing\n");
  if (missing.umbrellas) std::printf("points and umbrellas: missing\n");
  if (missing.hlod) std::printf("octree of triangles and points: missing\n");
  if (missing.methods) std::printf("methods: not tried yet, so it is open whether there will be images\n");
  if (missing.declaration)
    std::printf("scene.json: missing, though nothing else is; lumigrid build -o %s writes it\n", scene.c_str());
  if (missing.points)
    std::printf("sampling points: not selected yet; of all faces of the grid most will not be needed\n");
  if (missing.images_light)
    std::printf("images: drawn %s, by another light than the scene's; lumigrid build -o %s draws them again\n",
                base::nameOf(missing.images_light->mode), scene.c_str());
  for (const repository::ShardGaps& shard : missing.images) {
    if (missing.shards != 0) std::printf("shard %u of %u: ", shard.shard.index, shard.shard.count);
    if (shard.being_written) {
      std::printf("being written by another process\n");
      continue;
    }
    std::printf("%s faces %s\n", formatCount(shard.faces).c_str(), missing.images_light ? "to draw again" : "missing");
    for (std::size_t i = 0; i < shard.gaps.size() && i < kMaxPrintedGaps; ++i)
      std::printf("  %s to %s: %s faces\n", placeOf(shard.gaps[i].first).c_str(), placeOf(shard.gaps[i].last).c_str(),
                  formatCount(shard.gaps[i].faces).c_str());
    if (shard.gaps.size() > kMaxPrintedGaps)
      std::printf("  and %zu more ranges (--json lists them)\n", shard.gaps.size() - kMaxPrintedGaps);
  }
  // A line for scripts: it is what sbatch --array takes.
  if (missing.shards != 0 && !missing.images.empty()) std::printf("shards: %s\n", arrayOf(missing.images).c_str());
}

}  // namespace

base::Result<std::uint32_t> shardsOf(const base::Scene& scene) {
  const auto it = scene.parameters.find(kShardsParameter);
  if (it == scene.parameters.end()) return std::uint32_t{0};
  // The number n is one exactly when shard 0 of n is a shard.
  auto shard = repository::parseShard("0/" + it->second);
  if (!shard)
    return base::Error{base::ErrorCode::kInvalidInput, "scene.json: parameter shards: '" + it->second +
                                                           "' is no number of shards; build the scene again"};
  return shard->count;
}

base::Result<std::vector<std::string>> orphanStores(const std::string& images, std::uint32_t shards) {
  LUMIGRID_ASSIGN_OR_RETURN(auto layout, repository::layoutOf(images));
  std::vector<std::string> orphans;
  if (layout.undivided && shards != 0) orphans.push_back(images);
  for (const repository::Shard& shard : layout.shards)
    if (shard.count != shards) orphans.push_back(repository::storeDirectory(images, shard.count, shard.index));
  return orphans;
}

int reportMissing(const std::string& scene, const MissingParts& missing, bool json) {
  if (json)
    printJson(scene, missing);
  else
    printText(scene, missing);
  return missing.any() ? kMissing : kDone;
}

std::string arrayOf(const std::vector<repository::ShardGaps>& shards) {
  std::ostringstream text;
  for (std::size_t i = 0; i < shards.size();) {
    std::size_t last = i;
    while (last + 1 < shards.size() && shards[last + 1].shard.index == shards[last].shard.index + 1) ++last;
    text << (i == 0 ? "" : ",") << shards[i].shard.index;
    if (last > i) text << '-' << shards[last].shard.index;
    i = last + 1;
  }
  return text.str();
}

}  // namespace server::cli
