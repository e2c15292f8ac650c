#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "repository/verify.h"
#include "server/cmd/commands.h"
#include "server/cmd/console.h"
#include "server/cmd/tuned.h"
#include "server/net/open_scene.h"

namespace server::cmd {
namespace {

struct InfoArguments {
  std::string scene;
  bool json = false;
};

struct Level {
  std::uint64_t triangles = 0, patches = 0;
  float max_error = 0.0F;
  float max_color_error = 0.0F;  // 0 … 1
};

std::vector<Level> levelsOf(const lod::patch::Hierarchy& hierarchy) {
  std::vector<Level> levels;
  for (const lod::patch::Patch& patch : hierarchy.patches) {
    if (levels.size() <= patch.level) levels.resize(patch.level + 1);
    Level& level = levels[patch.level];
    level.triangles += patch.triangles;
    ++level.patches;
    if (patch.producer == lod::patch::kNoGroup) continue;
    const lod::patch::Group& group = hierarchy.groups[patch.producer];
    level.max_error = std::max(level.max_error, group.error);
    level.max_color_error = std::max(level.max_color_error, group.attribute_error);
  }
  return levels;
}

nlohmann::json describeHierarchy(const OpenScene& open) {
  const lod::patch::Hierarchy& h = open.patches.hierarchy();
  nlohmann::json j{{"bytes", open.patches.fileBytes()},
                   {"groups", h.groups.size()},
                   {"patches", h.patches.size()},
                   {"lattice_step", h.lattice.step},
                   {"position_error", h.lattice.positionError()},
                   {"levels", nlohmann::json::array()}};
  for (const Level& level : levelsOf(h))
    j["levels"].push_back({{"triangles", level.triangles},
                           {"patches", level.patches},
                           {"max_error", level.max_error},
                           {"max_color_error", level.max_color_error}});
  return j;
}

nlohmann::json describeImages(const OpenScene& open, const repository::Contents& contents) {
  const repository::Grid& grid = open.data.welcome.grid;
  return {{"images", contents.faces - contents.empty},
          {"empty", contents.empty},
          {"expected", grid.faceCount()},
          {"jpeg_bytes", contents.jpeg_bytes},
          {"coverage_bytes", contents.coverage_bytes},
          {"unreadable", contents.unreadable},
          {"grid", {grid.count.x, grid.count.y, grid.count.z}},
          {"spacing", grid.spacing},
          {"face_size", grid.face_size}};
}

void print(const InfoArguments& a, const nlohmann::json& j, const std::string& tuned) {
  const auto& s = j["scene"];
  std::printf("%s: %s triangles, colours: %s, light: %s, units: %s\n", a.scene.c_str(),
              formatCount(s["triangles"].get<std::uint64_t>()).c_str(), s["has_colors"].get<bool>() ? "yes" : "no",
              s["light"]["mode"].get<std::string>().c_str(), s["units"].get<std::string>().c_str());
  std::printf("box %s to %s\n", s["box_min"].dump().c_str(), s["box_max"].dump().c_str());
  for (const auto& source : s["sources"])
    std::printf("source %s, %s\n", source["path"].get<std::string>().c_str(),
                formatBytes(source["bytes"].get<std::uint64_t>()).c_str());
  for (const auto& [what, count] : s["repairs"].items())
    std::printf("repaired: %s %s\n", formatCount(count.get<std::uint64_t>()).c_str(), what.c_str());

  const auto& h = j["hierarchy"];
  std::printf("hierarchy: %s patches in %s groups, %s; positions within %g\n",
              formatCount(h["patches"].get<std::uint64_t>()).c_str(),
              formatCount(h["groups"].get<std::uint64_t>()).c_str(),
              formatBytes(h["bytes"].get<std::uint64_t>()).c_str(), h["position_error"].get<double>());
  int number = 0;
  for (const auto& level : h["levels"])
    std::printf("  level %2d: %12s triangles %8s patches, error up to %g\n", number++,
                formatCount(level["triangles"].get<std::uint64_t>()).c_str(),
                formatCount(level["patches"].get<std::uint64_t>()).c_str(), level["max_error"].get<double>());
  if (!j.contains("images")) {
    std::printf("images: none\n");
    return;
  }
  const auto& i = j["images"];
  const auto images = i["images"].get<std::uint64_t>();
  const auto expected = i["expected"].get<std::uint64_t>();
  std::printf("images: %s of %d x %d pixels, %s faces see nothing; grid %s, spacing %g\n", formatCount(images).c_str(),
              i["face_size"].get<int>(), i["face_size"].get<int>(),
              formatCount(i["empty"].get<std::uint64_t>()).c_str(), i["grid"].dump().c_str(),
              i["spacing"].get<double>());
  std::printf(
      "  %s JPEG, %s coverage, %s an image\n", formatBytes(i["jpeg_bytes"].get<std::uint64_t>()).c_str(),
      formatBytes(i["coverage_bytes"].get<std::uint64_t>()).c_str(),
      formatBytes(
          images == 0 ? 0 : (i["jpeg_bytes"].get<std::uint64_t>() + i["coverage_bytes"].get<std::uint64_t>()) / images)
          .c_str());
  if (!tuned.empty()) std::printf("  %s\n", tuned.c_str());
  if (images + i["empty"].get<std::uint64_t>() != expected)
    std::printf("  %s faces are missing; run the same `lumigrid build` again\n",
                formatCount(expected - images - i["empty"].get<std::uint64_t>()).c_str());
}

int run(const InfoArguments& a) {
  auto open = openScene(a.scene);
  if (!open) return fail(open.error());
  nlohmann::json j;
  std::string tuned_line;
  j["scene"] = nlohmann::json::parse((*open)->scene_json.begin(), (*open)->scene_json.end());
  j["triangles"] = (*open)->scene.triangles;
  j["hierarchy"] = describeHierarchy(**open);
  if ((*open)->images) {
    auto contents = repository::contentsOf(*(*open)->images);
    if (!contents) return fail(contents.error());
    j["images"] = describeImages(**open, *contents);
    const Parameters& parameters = (*open)->scene.parameters;
    const auto tuned = storedChoice(parameters);
    if (!tuned) return fail(base::within(a.scene + "/scene.json", tuned.error()));
    if (*tuned) {
      j["images"]["tuned"] = tunedJson(**tuned);
      const auto asked = parameters.find("tune");
      tuned_line = "tuned to " + (asked == parameters.end() ? "?" : asked->second) + " dB: " + describeChoice(**tuned);
    }
  }
  if (a.json)
    std::printf("%s\n", j.dump(2).c_str());
  else
    print(a, j, tuned_line);
  return kDone;
}

}  // namespace

Run addInfo(CLI::App& command) {
  auto a = std::make_shared<InfoArguments>();
  command.add_option("SCENE", a->scene, "scene directory")->required();
  command.add_flag("--json", a->json, "as JSON");
  return [a] { return run(*a); };
}

}  // namespace server::cmd
