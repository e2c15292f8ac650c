#include "server/bake/store_parameters.h"

#include <array>
#include <cstdio>
#include <sstream>

#include "repository/sampling/parameters.h"

namespace server {
namespace {

// Nine digits bring a float back exactly.
std::string number(float v) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.9g", static_cast<double>(v));
  return text.data();
}

std::string numbers(const glm::vec3& v) {
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "[%.9g, %.9g, %.9g]", static_cast<double>(v.x), static_cast<double>(v.y),
                static_cast<double>(v.z));
  return text.data();
}

std::string selectionText(const PointSelection& selection) {
  if (selection.views == 0) return "";
  std::ostringstream text;
  text << ",\n\"demand views\": " << selection.views
       << ",\n\"demand worth\": " << number(static_cast<float>(selection.worth));
  if (selection.budget_bytes != 0) text << ",\n\"budget\": " << selection.budget_bytes;
  if (selection.by_viewers) text << ",\n\"demand by viewers\": true";
  return text.str();
}

}  // namespace

std::string storeParameters(const base::Scene& scene, const BakeOptions& options) {
  const repository::Grid& grid = options.grid;
  std::string patch_sha256;
  for (const base::ScenePart& part : scene.parts)
    if (part.file == "patch.lgp") patch_sha256 = part.sha256;
  std::ostringstream text;
  text << "{\n\"version\": 1"
       << ",\n\"grid\": {\"first\": " << numbers(grid.first) << ", \"spacing\": " << number(grid.spacing)
       << ", \"count\": [" << grid.count.x << ", " << grid.count.y << ", " << grid.count.z << "]"
       << ", \"face_size\": " << grid.face_size << "},\n\"quality\": " << options.quality << ",\n\"subsampling\": \""
       << repository::nameOf(options.subsampling) << "\""
       << ",\n\"tolerance\": " << number(options.tolerance_px) << ",\n\"supersampling\": " << options.supersampling
       << ",\n\"light\": \"" << (scene.light.mode == base::LightMode::kUnlit ? "unlit" : "soft") << "\""
       << ",\n\"light direction\": " << numbers(scene.light.direction) << ",\n\"patch.lgp\": \"" << patch_sha256 << "\""
       << selectionText(options.selection) << "\n}\n";
  return options.points ? repository::withTree(text.str(), *options.points) : text.str();
}

base::Result<void> claimStore(repository::Store& store, const std::string& parameters) {
  const auto builtWith = [](const std::string& difference) {
    return base::Error{base::ErrorCode::kExists, "the image repository was built with " + difference +
                                                     "; give the same options, or --force to build it anew"};
  };
  LUMIGRID_ASSIGN_OR_RETURN(const auto stored, store.readMeta());
  if (stored && *stored != parameters) return builtWith(repository::firstDifference(*stored, parameters));
  if (stored) return {};
  LUMIGRID_ASSIGN_OR_RETURN(const auto size, store.size());
  if (size > 0) return builtWith("unknown parameters");
  return store.writeMeta(parameters);
}

}  // namespace server
