#include "base/json/scene_file.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/camera.h"
#include "base/file.h"
#include "base/json/parse.h"
#include "base/json/vector.h"
#include "base/text.h"

namespace base {
namespace {

using nlohmann::json;

// Reads typed members of a JSON object, and remembers the path of the first that is missing or of another type.
class Fields {
 public:
  Fields(const json& object, std::string place, std::string& problem)
      : object_(object), place_(std::move(place)), problem_(problem) {
    if (!object.is_object()) fail("is not an object");
  }
  template <class T>
  T get(const char* key) {
    const json* member = find(key);
    if (member == nullptr) return T{};
    if (isA<T>(*member)) return member->get<T>();
    fail(std::string(key) + " has the wrong type");
    return T{};
  }
  /// Reads an object whose members all have the same type.
  template <class T>
  std::map<std::string, T> map(const char* key) {
    std::map<std::string, T> all;
    const json* member = find(key);
    if (member == nullptr) return all;
    if (!member->is_object()) return fail(std::string(key) + " is not an object"), all;
    for (auto it = member->begin(); it != member->end(); ++it) {
      const json& value = *it;
      if (isA<T>(value))
        all[it.key()] = value.get<T>();
      else
        fail(std::string(key) + ": a value has the wrong type");
    }
    return all;
  }
  double number(const char* key) {
    const json* member = find(key);
    if (member == nullptr) return 0.0;
    if (member->is_number()) return member->get<double>();
    fail(std::string(key) + " is not a number");
    return 0.0;
  }
  glm::dvec3 vector(const char* key) {
    const json* member = find(key);
    if (member == nullptr) return glm::dvec3(0.0);
    const auto v = vectorFrom(*member);
    if (!v) fail(std::string(key) + " is not three numbers");
    return v.value_or(glm::dvec3(0.0));
  }
  const json& child(const char* key) {
    static const json kEmpty;
    const json* member = find(key);
    return member == nullptr ? kEmpty : *member;
  }
  void fail(const std::string& problem) {
    if (problem_.empty()) problem_ = place_ + problem;
  }

 private:
  template <class T>
  static bool isA(const json& value) {
    if constexpr (std::is_same_v<T, std::string>) return value.is_string();
    if constexpr (std::is_same_v<T, bool>) return value.is_boolean();
    if constexpr (std::is_same_v<T, std::uint64_t>) return value.is_number_unsigned();
  }
  const json* find(const char* key) {
    if (!object_.is_object()) return nullptr;
    auto it = object_.find(key);
    if (it != object_.end()) return &*it;
    fail(std::string(key) + " is missing");
    return nullptr;
  }
  const json& object_;
  std::string place_;
  std::string& problem_;
};

void readHull(const json& list, Scene& scene, Fields& top) {
  if (!list.is_array() || list.size() > kMaxHull) return top.fail("hull is no list of at most 32 points");
  for (const json& item : list) {
    const auto point = vectorFrom(item);
    if (!point || !(glm::length(*point) <= kMaxCoordinate)) return top.fail("hull: a point is not three numbers");
    scene.hull.push_back(*point);
  }
}

/// Reads what `lumigrid set` may have added; each member may be absent.
void readAppearance(const json& document, Scene& scene, std::string& problem) {
  Fields top(document, "", problem);
  if (document.contains("title")) scene.title = top.get<std::string>("title");
  if (document.contains("start_direction")) scene.start_direction = top.vector("start_direction");
  if (document.contains("start_view")) scene.start_view = top.get<std::string>("start_view");
  if (document.contains("interior")) scene.interior = top.get<bool>("interior");
  if (document.contains("interior_grid")) {
    const auto points = top.get<std::uint64_t>("interior_grid");
    if (points > kMaxInteriorGrid) top.fail("interior_grid is beyond 1024");
    scene.interior_grid = static_cast<std::uint32_t>(std::min<std::uint64_t>(points, kMaxInteriorGrid));
  }
  if (document.contains("hull")) readHull(top.child("hull"), scene, top);
  if (document.contains("north")) scene.north = top.number("north");
  if (std::abs(scene.north.value_or(0.0)) > 360.0) top.fail("north is beyond 360 degrees");
  if (document.contains("crs")) scene.crs = top.get<std::string>("crs");
  if (document.contains("attribution")) scene.attribution = top.get<std::string>("attribution");
  if (document.contains("background")) {
    scene.background = parseRgb(top.get<std::string>("background"));
    if (!scene.background) top.fail("background is no colour #rrggbb");
  }
}

/// `name`: that of the member.
Light lightFrom(const json& object, const std::string& name, std::string& problem) {
  Fields fields(object, name + ": ", problem);
  Light light;
  const auto mode = lightModeNamed(fields.get<std::string>("mode"));
  if (!mode) fields.fail("mode is none of unlit, soft, hard-shadows and soft-shadows");
  light.mode = mode.value_or(LightMode::kSoft);
  light.direction = glm::vec3(fields.vector("direction"));
  for (int i = 0; i < 3; ++i)
    if (!std::isfinite(light.direction[i])) fields.fail("direction is too long");
  if (!light.hasShadows()) return light;
  // Normalized before it is rounded, since the square of a long one is beyond a float.
  const glm::dvec3 direction = fields.vector("direction");
  if (glm::length(direction) > 0.0)
    light.direction = glm::vec3(glm::normalize(direction));
  else
    fields.fail("direction is zero");
  if (object.contains("position")) light.position = fields.vector("position");
  if (light.position && !(glm::length(*light.position) <= kMaxCoordinate)) fields.fail("position is too far away");
  if (light.mode != LightMode::kSoftShadows) return light;
  light.size = fields.number("size");
  constexpr double kAllSky = 180.0;  // degrees
  if (!(light.size > 0.0 && light.size <= (light.position ? kMaxCoordinate : kAllSky)))
    fields.fail("size is out of range");
  return light;
}

void readLights(const json& document, Scene& scene, std::string& problem) {
  Fields top(document, "", problem);
  scene.light = lightFrom(top.child("light"), "light", problem);
  if (!document.contains("images_light")) return;
  // Earlier programs wrote the mode alone.
  json drawn = document["images_light"];
  if (drawn.is_string()) drawn = {{"mode", drawn}, {"direction", toJson(glm::dvec3(scene.light.direction))}};
  scene.images_light = lightFrom(drawn, "images_light", problem);
}

void readLists(const json& document, Scene& scene, std::string& problem) {
  Fields top(document, "", problem);
  for (const json& item : top.child("sources")) {
    Fields f(item, "sources: ", problem);
    scene.sources.push_back({f.get<std::string>("path"), f.get<std::uint64_t>("bytes"), f.get<std::string>("sha256")});
  }
  for (const json& item : top.child("parts")) {
    Fields f(item, "parts: ", problem);
    scene.parts.push_back({f.get<std::string>("file"), f.get<std::uint64_t>("bytes"), f.get<std::string>("sha256")});
    if (!item.contains("opening")) continue;
    for (const json& range : f.child("opening")) {
      if (range.is_array() && range.size() == 2 && range[0].is_number_unsigned() && range[1].is_number_unsigned())
        scene.parts.back().opening.push_back({range[0].get<std::uint64_t>(), range[1].get<std::uint64_t>()});
      else
        problem = "parts: opening holds something else than pairs of an offset and a length";
    }
  }
  scene.repairs = top.map<std::uint64_t>("repairs");
  if (document.contains("open_edges"))
    scene.border = SceneBorder{top.get<std::uint64_t>("source_open_edges"), top.get<std::uint64_t>("open_edges"),
                               top.number("largest_movement")};
  scene.parameters = top.map<std::string>("parameters");
}

json lightJson(const Light& light) {
  json object{{"mode", nameOf(light.mode)}, {"direction", toJson(glm::dvec3(light.direction))}};
  if (light.position) object["position"] = toJson(*light.position);
  if (light.mode == LightMode::kSoftShadows) object["size"] = light.size;
  return object;
}

}  // namespace

Result<Scene> readScene(const std::string& directory) {
  auto scene = readSceneFile(directory + "/scene.json");
  if (scene || scene.error().code != ErrorCode::kNotFound) return scene;
  if (MappedFile::open(directory + "/" + kBuildingFile))
    return Error{ErrorCode::kNotFound,
                 directory + ": this scene is not finished; run the same `lumigrid build` again to go on"};
  return Error{
      ErrorCode::kNotFound,
      directory + ": not a scene (no scene.json in it); make one with `lumigrid build MESH -o " + directory + "`"};
}

Result<Scene> readSceneFile(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(auto bytes, readFile(path));
  return parseScene(std::string(bytes.begin(), bytes.end()), path);
}

Result<Scene> parseScene(const std::string& text, const std::string& name) {
  const json document = parseJson(viewOfText(text));
  if (!document.is_object()) return Error{ErrorCode::kInvalidInput, name + ": not valid JSON; build the scene again"};
  Scene scene;
  std::string problem;
  Fields top(document, "", problem);
  const auto version = top.get<std::uint64_t>("version");
  if (problem.empty() && version != kSceneVersion)
    return Error{ErrorCode::kVersion, name + ": format version " + std::to_string(version) + ", this program reads " +
                                          std::to_string(kSceneVersion)};
  scene.box_min = top.vector("box_min");
  scene.box_max = top.vector("box_max");
  scene.origin = top.vector("origin");
  scene.up = top.vector("up");
  scene.units = top.get<std::string>("units");
  readAppearance(document, scene, problem);
  scene.has_colors = top.get<bool>("has_colors");
  scene.triangles = top.get<std::uint64_t>("triangles");
  readLights(document, scene, problem);
  readLists(document, scene, problem);
  if (problem.empty() && !glm::all(glm::lessThanEqual(scene.box_min, scene.box_max)))
    problem = "box_min exceeds box_max";
  if (problem.empty() && !(glm::length(scene.up) > 0.0)) problem = "up is zero";
  if (problem.empty() && scene.start_direction && !(glm::length(*scene.start_direction) > 0.0))
    problem = "start_direction is zero";
  if (!problem.empty()) return Error{ErrorCode::kInvalidInput, name + ": " + problem + "; build the scene again"};
  return scene;
}

std::string formatScene(const Scene& scene) {
  json document;
  document["version"] = scene.version;
  document["sources"] = json::array();
  for (const SceneSource& s : scene.sources)
    document["sources"].push_back({{"path", s.path}, {"bytes", s.bytes}, {"sha256", s.sha256}});
  document["box_min"] = toJson(scene.box_min);
  document["box_max"] = toJson(scene.box_max);
  document["origin"] = toJson(scene.origin);
  document["units"] = scene.units;
  if (!scene.title.empty()) document["title"] = scene.title;
  document["up"] = toJson(scene.up);
  if (scene.start_direction) document["start_direction"] = toJson(*scene.start_direction);
  if (!scene.start_view.empty()) document["start_view"] = scene.start_view;
  if (scene.interior) document["interior"] = true;
  if (scene.interior_grid > 0) document["interior_grid"] = scene.interior_grid;
  for (const glm::dvec3& point : scene.hull) document["hull"].push_back(toJson(point));
  if (scene.north) document["north"] = *scene.north;
  if (!scene.crs.empty()) document["crs"] = scene.crs;
  if (!scene.attribution.empty()) document["attribution"] = scene.attribution;
  if (scene.background) document["background"] = formatRgb(*scene.background);
  document["light"] = lightJson(scene.light);
  if (scene.images_light) document["images_light"] = lightJson(*scene.images_light);
  document["has_colors"] = scene.has_colors;
  document["triangles"] = scene.triangles;
  document["repairs"] = scene.repairs;
  if (scene.border) {
    document["source_open_edges"] = scene.border->source_open_edges;
    document["open_edges"] = scene.border->open_edges;
    document["largest_movement"] = scene.border->largest_movement;
  }
  document["parameters"] = scene.parameters;
  document["parts"] = json::array();
  for (const ScenePart& p : scene.parts) {
    document["parts"].push_back({{"file", p.file}, {"bytes", p.bytes}, {"sha256", p.sha256}});
    for (const FileRange& range : p.opening)
      document["parts"].back()["opening"].push_back(json::array({range.offset, range.length}));
  }
  return document.dump(2) + "\n";
}

glm::dvec3 northOf(const Scene& scene) {
  return scene.north ? northDirection(scene.up, *scene.north) : glm::dvec3(0.0);
}

const char* nameOf(LightMode mode) {
  switch (mode) {
    case LightMode::kUnlit:
      return "unlit";
    case LightMode::kSoft:
      break;
    case LightMode::kHardShadows:
      return "hard-shadows";
    case LightMode::kSoftShadows:
      return "soft-shadows";
  }
  return "soft";
}

std::optional<LightMode> lightModeNamed(std::string_view name) {
  for (const LightMode mode : kLightModes)
    if (name == nameOf(mode)) return mode;
  return std::nullopt;
}

bool isCrsName(std::string_view text) {
  const auto isLetter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); };
  const auto isAllowed = [&](char c) {
    return isLetter(c) || (c >= '0' && c <= '9') || std::string_view(":+-._/").find(c) != std::string_view::npos;
  };
  const std::size_t colon = text.find(':');
  return !text.empty() && text.size() <= kMaxCrs && isLetter(text.front()) && text.back() != ':' &&
         colon != std::string_view::npos && std::all_of(text.begin(), text.end(), isAllowed);
}

Result<void> writeSceneFile(const Scene& scene, const std::string& path) {
  return writeFileAtomically(path, viewOfText(formatScene(scene)));
}

namespace {

constexpr std::size_t kIdDigits = 32;

// The positions in "patch-<id>.lgp" where "-<id>" and ".lgp" begin; both are equal for a name without an id.
std::pair<std::size_t, std::size_t> placeOfId(const std::string& file) {
  const std::size_t slash = file.rfind('/');
  std::size_t dot = file.rfind('.');
  if (dot == std::string::npos || (slash != std::string::npos && dot < slash)) dot = file.size();
  if (dot < kIdDigits + 2) return {dot, dot};
  const std::size_t dash = dot - kIdDigits - 1;
  const std::string id = file.substr(dash + 1, kIdDigits);
  if (file[dash] != '-' || id.find_first_not_of("0123456789abcdef") != std::string::npos) return {dot, dot};
  return {dash, dot};
}

}  // namespace

std::string publishedName(const std::string& file, const std::string& sha256) {
  const auto [begin, end] = placeOfId(file);
  return file.substr(0, begin) + "-" + sha256.substr(0, kIdDigits) + file.substr(end);
}

bool isPublishedName(const std::string& file) {
  const auto [begin, end] = placeOfId(file);
  return begin != end;
}

std::optional<std::string> partFile(const Scene& scene, const std::string& stem, const std::string& extension) {
  for (const ScenePart& part : scene.parts) {
    const auto [begin, end] = placeOfId(part.file);
    if (part.file.substr(0, begin) == stem && part.file.substr(end) == extension) return part.file;
  }
  return std::nullopt;
}

std::string patchPath(const std::string& directory, const Scene& scene) {
  return directory + "/" + partFile(scene, "patch", ".lgp").value_or("patch.lgp");
}

Sha256Digest hierarchyDigest(const Scene& scene) {
  Sha256Digest digest{};
  const auto file = partFile(scene, "patch", ".lgp");
  for (const ScenePart& part : scene.parts) {
    const auto bytes = part.file == file ? bytesOfHex(part.sha256) : std::nullopt;
    if (bytes && bytes->size() == digest.size()) std::copy(bytes->begin(), bytes->end(), digest.begin());
  }
  return digest;
}

std::string splatPath(const std::string& directory, const Scene& scene) {
  return streamedPath(directory, scene, kSplatMethod);
}

const StreamedMethod* methodWithoutPatches(const Scene& scene) {
  if (partFile(scene, "patch", ".lgp")) return nullptr;
  for (const StreamedMethod& method : kStreamedMethods)
    if (partFile(scene, method.name, method.extension)) return &method;
  return nullptr;
}

std::string streamedPath(const std::string& directory, const Scene& scene, const StreamedMethod& method) {
  return directory + "/" + partFile(scene, method.name, method.extension).value_or(method.file());
}

Result<std::string> sha256OfFile(const std::string& path, const std::function<bool()>& go_on) {
  // Read in buffers that fit the cache: a memory map larger than memory would count against this process.
  const std::unique_ptr<std::FILE, decltype(&std::fclose)> file(std::fopen(path.c_str(), "rbe"), &std::fclose);
  if (!file) return systemError(path, "open", errno);
  Sha256 hash;
  Bytes buffer(std::size_t{1} << 17);
  for (std::size_t n = 0; (n = std::fread(buffer.data(), 1, buffer.size(), file.get())) > 0;) {
    if (go_on && !go_on()) return Error{ErrorCode::kCancelled, path + ": reading it was cancelled"};
    hash.add(ByteView(buffer).first(n));
  }
  if (std::ferror(file.get()) != 0) return systemError(path, "read", errno);
  return hexOf(hash.finish());
}

}  // namespace base
