#pragma once
// Reads and writes scene.json, which describes a scene and lists its files (docs/formats/scene.md).
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/byte_range.h"
#include "base/error.h"
#include "base/geometry.h"
#include "base/hash/sha256.h"
#include "base/image.h"

namespace base {

inline constexpr int kSceneVersion = 1;

/// kUnlit shows the colours as scanned; kSoft is a soft directional light for scenes without colours. The others shade
/// by a light that throws shadows: sharp ones, or ones with penumbrae.
enum class LightMode { kUnlit, kSoft, kHardShadows, kSoftShadows };
inline constexpr LightMode kLightModes[] = {LightMode::kUnlit, LightMode::kSoft, LightMode::kHardShadows,
                                            LightMode::kSoftShadows};

struct Light {
  LightMode mode = LightMode::kSoft;
  /// Unit, from the surface towards the light, scene axes; of a light at a place: from the middle of the scene.
  glm::vec3 direction{0.35F, 0.45F, 0.82F};
  std::optional<glm::dvec3> position;  ///< world; of a light that throws shadows and is not infinitely far
  /// Diameter of a light that throws soft shadows: degrees, or scene units with a position; else 0.
  double size = 0.0;
  bool hasShadows() const { return mode == LightMode::kHardShadows || mode == LightMode::kSoftShadows; }
  friend bool operator==(const Light&, const Light&) = default;
};

struct SceneSource {
  std::string path;
  std::uint64_t bytes = 0;
  std::string sha256;
};

struct ScenePart {
  std::string file;                     ///< relative to the scene directory
  std::uint64_t bytes = 0;              ///< 0 for a directory
  std::string sha256;                   ///< empty for a directory (its values carry checksums)
  std::vector<FileRange> opening = {};  ///< of a published part: what a viewer reads first (docs/formats/packs.md)
};

/// The source's border, and what stitching did to it.
struct SceneBorder {
  std::uint64_t source_open_edges = 0;  ///< edges of only one triangle
  std::uint64_t open_edges = 0;         ///< the same in the scene's leaves
  double largest_movement = 0.0;        ///< of a stitched place, scene units
};

struct Scene {
  int version = kSceneVersion;
  std::vector<SceneSource> sources;
  glm::dvec3 box_min{0.0}, box_max{0.0};  ///< world
  glm::dvec3 origin{0.0};                 ///< world position of scene-local (0, 0, 0)
  std::string units = "unknown";
  std::string title;                          ///< what viewers call it; empty: by its place
  glm::dvec3 up{0.0, 0.0, 1.0};               ///< world; the up vector of the first view
  std::optional<glm::dvec3> start_direction;  ///< unit, world: where the first view looks; nothing: viewers choose
  std::string start_view;                     ///< permalink of the first view; empty: the whole model, so seen
  bool interior = false;                      ///< scanned from inside: people look at it from its rooms
  std::uint32_t interior_grid = 0;            ///< points along the longest side its rooms ask for; 0: the usual
  /// World: at most kMaxHull points whose convex hull holds the model, strays far from it excepted; empty: the box
  /// does.
  std::vector<glm::dvec3> hull;
  std::optional<double> north;    ///< degrees, docs/formats/scene.md, "North"; nothing: not known
  std::string crs;                ///< coordinate reference system of world coordinates, "EPSG:32718"; empty: not known
  std::string attribution;        ///< whom viewers name as the scan's authors; empty: nobody
  std::optional<Rgb> background;  ///< of pictures, where there is no model; nothing: viewers choose
  Light light;
  std::optional<Light> images_light;  ///< that the images there were drawn in; nothing: in `light`
  bool has_colors = false;
  std::uint64_t triangles = 0;
  std::map<std::string, std::uint64_t> repairs;
  std::optional<SceneBorder> border;              ///< nothing in scenes of earlier programs and of points
  std::map<std::string, std::string> parameters;  ///< options the scene was built with, by long option name
  std::vector<ScenePart> parts;

  base::Aabb localBox() const {
    base::Aabb box;
    box.add(glm::vec3(box_min - origin));
    box.add(glm::vec3(box_max - origin));
    return box;
  }
};

/// The unit world vector towards north, perpendicular to `up`; zero when north is not known.
glm::dvec3 northOf(const Scene& scene);
/// "unlit", "soft", "hard-shadows" or "soft-shadows", as scene.json has it.
const char* nameOf(LightMode mode);
std::optional<LightMode> lightModeNamed(std::string_view name);
/// Most points of a scene's hull.
inline constexpr std::size_t kMaxHull = 32;
inline constexpr std::uint32_t kMaxInteriorGrid = 1024;  ///< points along a side, the most of --grid
/// Longest attribution and name of a coordinate reference system, bytes.
inline constexpr std::size_t kMaxAttribution = 500, kMaxCrs = 64;
/// Whether the text names a coordinate reference system by authority and code: "EPSG:32718", "OGC:CRS84",
/// "EPSG:25832+7837", "urn:ogc:def:crs:EPSG::4978". It is not looked up.
bool isCrsName(std::string_view text);

/// Reads directory/scene.json, which only a finished scene has.
Result<Scene> readScene(const std::string& directory);
/// The name of the same document while a build is in progress.
inline constexpr const char* kBuildingFile = "building.json";
Result<Scene> readSceneFile(const std::string& path);
Result<void> writeSceneFile(const Scene& scene, const std::string& path);
Result<Scene> parseScene(const std::string& text, const std::string& name);
std::string formatScene(const Scene& scene);

/// The file of a part, relative to the scene: "patch.lgp" for stem "patch" and extension ".lgp"; in a published scene
/// the name has an id, "patch-<32 hexadecimal digits>.lgp" (docs/formats/packs.md). nullopt when the scene lists
/// neither.
std::optional<std::string> partFile(const Scene& scene, const std::string& stem, const std::string& extension);
/// The path of the patch hierarchy: directory/patch.lgp, or its published name.
std::string patchPath(const std::string& directory, const Scene& scene);
/// The SHA-256 of the patch hierarchy as the scene lists it, by which scenes of other surfaces are told apart; zeros
/// where it lists none. A published scene has that of the one it was made from.
Sha256Digest hierarchyDigest(const Scene& scene);
/// The path of the splat tree: directory/qsplat.lgq, or its published name.
std::string splatPath(const std::string& directory, const Scene& scene);
/// A method of one file that viewers stream by ranges, with no need of patches. The file is called as the method is:
/// qsplat.lgq.
struct StreamedMethod {
  const char* name;
  const char* extension;
  std::string file() const { return std::string(name) + extension; }
};
inline constexpr StreamedMethod kSplatMethod{"qsplat", ".lgq"};
inline constexpr StreamedMethod kUmbrellaMethod{"pmr", ".lgm"};
inline constexpr StreamedMethod kHlodMethod{"hlod", ".lgh"};
inline constexpr StreamedMethod kStreamedMethods[] = {kSplatMethod, kUmbrellaMethod, kHlodMethod};
/// The method of a scene without patches that viewers show unless they are told another; null: the scene has patches,
/// or nothing to stream.
const StreamedMethod* methodWithoutPatches(const Scene& scene);
/// The path of the method's file: directory/qsplat.lgq, or its published name.
std::string streamedPath(const std::string& directory, const Scene& scene, const StreamedMethod& method);
/// Turns "patch.lgp", or a name that has an id already, into "patch-<id>.lgp". `sha256`: of the bytes, lower-case hex.
std::string publishedName(const std::string& file, const std::string& sha256);
/// Whether the name has an id before the last dot, as publishedName gives it.
bool isPublishedName(const std::string& file);

/// SHA-256 of a file as lower-case hex. `go_on` may be null; it is called now and then, and false cancels. Errors: kIo,
/// kNotFound, kCancelled.
Result<std::string> sha256OfFile(const std::string& path, const std::function<bool()>& go_on = nullptr);

}  // namespace base
