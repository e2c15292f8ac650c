#include "base/json/camera_file.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/constants.hpp>
#include <nlohmann/json.hpp>

#include "base/file.h"
#include "base/json/parse.h"
#include "base/json/vector.h"

namespace base {
namespace {

using nlohmann::json;

constexpr double kMaxRate = 1000.0;  // frames a second
constexpr int kMaxSide = 16384;      // pixels; the protocol's limit as well

Error bad(const std::string& name, const std::string& problem) {
  return {ErrorCode::kInvalidInput, name + ": " + problem + " (docs/formats/camera.md)"};
}

bool readVector(const json& object, const char* key, glm::dvec3& v) {
  const auto it = object.find(key);
  const auto read = it == object.end() ? std::nullopt : vectorFrom(*it);
  v = read.value_or(v);
  return read.has_value();
}

// Reads width, height, fov_y_degrees and ortho_height, as far as they are given; frames inherit the path's.
Result<void> readLens(const json& object, const std::string& name, ViewCamera& camera) {
  for (auto [key, side] : {std::pair{"width", &camera.width}, std::pair{"height", &camera.height}}) {
    auto it = object.find(key);
    if (it == object.end()) continue;
    if (!it->is_number_integer() || it->get<std::int64_t>() < 1 || it->get<std::int64_t>() > kMaxSide)
      return bad(name, std::string(key) + " must be 1 to 16384");
    *side = it->get<int>();
  }
  if (auto it = object.find("fov_y_degrees"); it != object.end()) {
    if (!it->is_number() || !(it->get<double>() > 0.0) || !(it->get<double>() < 180.0))
      return bad(name, "fov_y_degrees must lie between 0 and 180");
    camera.fov_y = glm::radians(it->get<double>());
  }
  if (auto it = object.find("ortho_height"); it != object.end()) {
    if (!it->is_number() || !(it->get<double>() >= 0.0) || !std::isfinite(it->get<double>()))
      return bad(name, "ortho_height must be a number of 0 (perspective) or more");
    camera.ortho_height = it->get<double>();
  }
  if (auto it = object.find("section"); it != object.end()) {
    SectionPlane section;
    const bool is_valid = it->is_object() && readVector(*it, "normal", section.normal) && it->contains("offset") &&
                          it->at("offset").is_number();
    const double length = is_valid ? glm::length(section.normal) : 0.0;
    if (!(length > 0.0) || !std::isfinite(length))
      return bad(name, "section must have a normal, three numbers of which not all are 0, and an offset");
    section.normal /= length;
    section.offset = it->at("offset").get<double>() / length;
    if (!(std::abs(section.offset) <= kMaxCoordinate)) return bad(name, "the offset of section must be within 1e12");
    camera.section = section;
  }
  return {};
}

Result<ViewCamera> cameraFrom(const json& object, const std::string& name, ViewCamera camera) {
  if (!object.is_object()) return bad(name, "not a camera object");
  LUMIGRID_TRY(readLens(object, name, camera));
  if (!readVector(object, "position", camera.position)) return bad(name, "position must be three numbers");
  glm::dvec3 target(0.0);
  if (readVector(object, "direction", camera.direction)) {
  } else if (readVector(object, "target", target)) {
    camera.direction = target - camera.position;
  } else {
    return bad(name, "direction or target must be three numbers");
  }
  if (object.contains("up") && !readVector(object, "up", camera.up)) return bad(name, "up must be three numbers");
  const double length = glm::length(camera.direction);
  if (!(length > 0.0) || !std::isfinite(length)) return bad(name, "direction is zero");
  camera.direction /= length;
  if (!(glm::length(glm::cross(camera.direction, camera.up)) > 1e-9 * glm::length(camera.up)))
    return bad(name, "up is parallel to direction");
  return camera;
}

// Reads frames_per_second and jumps, as far as they are given.
Result<void> readTimes(const json& document, const std::string& name, CameraPath& path) {
  if (auto it = document.find("frames_per_second"); it != document.end()) {
    if (!it->is_number() || !(it->get<double>() > 0.0) || !(it->get<double>() <= kMaxRate))
      return bad(name, "frames_per_second must be above 0 and at most 1000");
    path.frames_per_second = it->get<double>();
  }
  if (auto it = document.find("jumps"); it != document.end()) {
    if (!it->is_boolean()) return bad(name, "jumps must be true or false");
    path.jumps = it->get<bool>();
  }
  return {};
}

// The members of a camera that a path may have for all frames.
json lensOf(const ViewCamera& c) {
  json lens{{"fov_y_degrees", glm::degrees(c.fov_y)}, {"width", c.width}, {"height", c.height}};
  if (c.orthographic()) lens["ortho_height"] = c.ortho_height;
  if (c.section) lens["section"] = {{"normal", toJson(c.section->normal)}, {"offset", c.section->offset}};
  return lens;
}

Result<json> parseFile(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(auto bytes, readFile(path));
  json document = parseJson(bytes);
  if (document.is_discarded()) return bad(path, "not valid JSON");
  return document;
}

}  // namespace

Result<ViewCamera> readCamera(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(auto document, parseFile(path));
  return cameraFrom(document, path, {});
}

Result<ViewCamera> parseCamera(const std::string& text, const std::string& name) {
  const json document = parseJson(viewOfText(text));
  if (document.is_discarded()) return bad(name, "not valid JSON");
  return cameraFrom(document, name, {});
}

Result<CameraPath> readCameraPath(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(auto document, parseFile(path));
  if (!document.is_object() || !document.contains("frames") || !document["frames"].is_array())
    return bad(path, "no list of frames");
  ViewCamera common;
  LUMIGRID_TRY(readLens(document, path, common));
  CameraPath read;
  LUMIGRID_TRY(readTimes(document, path, read));
  for (const json& item : document["frames"]) {
    LUMIGRID_ASSIGN_OR_RETURN(auto camera,
                              cameraFrom(item, path + ": frame " + std::to_string(read.frames.size()), common));
    read.frames.push_back(camera);
  }
  if (read.frames.empty()) return bad(path, "the list of frames is empty");
  return read;
}

std::string formatCameraPath(const CameraPath& path) {
  json document;
  document["version"] = 1;
  if (path.frames_per_second > 0.0) document["frames_per_second"] = path.frames_per_second;
  if (path.jumps) document["jumps"] = true;
  const bool one_lens = std::all_of(path.frames.begin(), path.frames.end(),
                                    [&](const ViewCamera& c) { return lensOf(c) == lensOf(path.frames.front()); });
  if (one_lens && !path.frames.empty()) document.update(lensOf(path.frames.front()));
  document["frames"] = json::array();
  for (const ViewCamera& c : path.frames) {
    json frame = {{"position", toJson(c.position)}, {"direction", toJson(c.direction)}, {"up", toJson(c.up)}};
    if (!one_lens) frame.update(lensOf(c));
    document["frames"].push_back(std::move(frame));
  }
  return document.dump(1) + "\n";
}

std::vector<ViewCamera> orbitPath(const glm::dvec3& box_min, const glm::dvec3& box_max, const glm::dvec3& up,
                                  int frames, double turns, double elevation, double distance, int width, int height) {
  const glm::dvec3 center = 0.5 * (box_min + box_max);
  const glm::dvec3 z = glm::normalize(up);
  const glm::dvec3 helper = std::abs(z.x) < 0.9 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
  const glm::dvec3 x = glm::normalize(helper - z * glm::dot(helper, z));
  const glm::dvec3 y = glm::cross(z, x);
  const double radius = distance * glm::length(box_max - box_min);
  std::vector<ViewCamera> path;
  for (int i = 0; i < frames; ++i) {
    const double angle = glm::two_pi<double>() * turns * i / frames;
    const glm::dvec3 outward =
        std::cos(elevation) * (std::cos(angle) * x + std::sin(angle) * y) + std::sin(elevation) * z;
    ViewCamera camera;
    camera.position = center + radius * outward;
    camera.direction = -outward;
    camera.up = z;
    camera.width = width;
    camera.height = height;
    path.push_back(camera);
  }
  return path;
}

}  // namespace base
