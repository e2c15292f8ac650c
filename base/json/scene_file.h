#pragma once
// scene.json: what a scene is and what it holds (DESIGN section 3; docs/formats/scene.md).
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/geometry.h"

namespace base {

inline constexpr int kSceneVersion = 1;

/// How surfaces are lit: kUnlit shows the colours as scanned; kSoft is a soft directional light for scenes without
/// colours.
enum class LightMode { kUnlit, kSoft };

struct Light {
  LightMode mode = LightMode::kSoft;
  glm::vec3 direction{0.35F, 0.45F, 0.82F};  ///< unit, from the surface towards the light, scene axes
  friend bool operator==(const Light&, const Light&) = default;
};

struct SceneSource {
  std::string path;
  std::uint64_t bytes = 0;
  std::string sha256;
};

struct ScenePart {
  std::string file;         ///< relative to the scene directory
  std::uint64_t bytes = 0;  ///< 0 for a directory
  std::string sha256;       ///< empty for a directory (its values carry checksums)
};

struct Scene {
  int version = kSceneVersion;
  std::vector<SceneSource> sources;
  glm::dvec3 box_min{0.0}, box_max{0.0};  ///< world
  glm::dvec3 origin{0.0};                 ///< world position of scene-local (0, 0, 0)
  std::string units = "unknown";
  glm::dvec3 up{0.0, 0.0, 1.0};  ///< world; which way the first view stands up
  Light light;
  bool has_colors = false;
  std::uint64_t triangles = 0;
  std::map<std::string, std::uint64_t> repairs;
  std::map<std::string, std::string> parameters;  ///< options the scene was built with, by long option name
  std::vector<ScenePart> parts;

  base::Aabb localBox() const {
    base::Aabb box;
    box.add(glm::vec3(box_min - origin));
    box.add(glm::vec3(box_max - origin));
    return box;
  }
};

/// directory/scene.json: a finished scene.
Result<Scene> readScene(const std::string& directory);
/// A build in progress keeps the same document under this name until everything is there.
inline constexpr const char* kBuildingFile = "building.json";
Result<Scene> readSceneFile(const std::string& path);
Result<void> writeSceneFile(const Scene& scene, const std::string& path);
Result<Scene> parseScene(const std::string& text, const std::string& name);
std::string formatScene(const Scene& scene);

/// The file of a part, relative to the scene: "patch.lgp" of stem "patch" and extension ".lgp"; in a published scene
/// its name holds its id, "patch-<32 hexadecimal digits>.lgp" (docs/formats/packs.md). Nothing when the scene lists
/// neither.
std::optional<std::string> partFile(const Scene& scene, const std::string& stem, const std::string& extension);
/// Where the patch hierarchy lies: directory/patch.lgp, or what a published scene calls it.
std::string patchPath(const std::string& directory, const Scene& scene);
/// The same of the tree of splats, qsplat.lgq.
std::string splatPath(const std::string& directory, const Scene& scene);
/// "patch-<id>.lgp" of "patch.lgp", or of what has an id already. `sha256`: of its bytes, lower-case hex.
std::string publishedName(const std::string& file, const std::string& sha256);
/// Whether that is a name that publishedName gives: an id before the last dot.
bool isPublishedName(const std::string& file);

/// SHA-256 of a file as lower-case hex. `go_on` may be empty; it is asked now and then, and false cancels. Errors: kIo,
/// kNotFound, kCancelled.
Result<std::string> sha256OfFile(const std::string& path, const std::function<bool()>& go_on = nullptr);

}  // namespace base
