#include "server/net/picture.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/constants.hpp>
#include <string>
#include <utility>

#include "base/format_text.h"
#include "base/number.h"
#include "base/png/png.h"
#include "protocol/message.h"
#include "server/render/tiling.h"

namespace server {
namespace {

constexpr int kMaxSide = 32'768;      // pixels; SceneRenderer draws no larger picture
constexpr Rgb kWhite{255, 255, 255};  // the background of formats without alpha, unless the scene has one
constexpr double kMinFovDegrees = 0.05, kMaxFovDegrees = 179.9;
constexpr double kMinTolerance = 0.2, kMaxTolerance = 1000.0;  // pixels; below the minimum nothing changes visibly
constexpr double kMinSine = 1e-6;                              // sine of the angle between up and direction

base::Error wrongRender(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "/render: " + problem + " (docs/formats/http.md)"};
}

// ---- Reading the query. Each known value is removed as it is read, so the values left at the end have unknown names.

class Values {
 public:
  explicit Values(Query query) : query_(std::move(query)) {}
  /// Removes the value of that name and returns it.
  std::optional<std::string> removeValue(std::string_view name) {
    const auto it = query_.find(name);
    if (it == query_.end()) return std::nullopt;
    return std::move(query_.extract(it).mapped());
  }
  const Query& left() const { return query_; }

 private:
  Query query_;
};

std::optional<glm::dvec3> parseVector(const std::string& text) {
  const std::size_t first = text.find(',');
  const std::size_t second = first == std::string::npos ? first : text.find(',', first + 1);
  if (second == std::string::npos) return std::nullopt;
  const std::string_view view(text);
  const auto x = base::parseNumber(view.substr(0, first));
  const auto y = base::parseNumber(view.substr(first + 1, second - first - 1));
  const auto z = base::parseNumber(view.substr(second + 1));
  if (!x || !y || !z) return std::nullopt;
  const glm::dvec3 vector(*x, *y, *z);
  for (int i = 0; i < 3; ++i)
    if (std::abs(vector[i]) > protocol::kMaxCoordinate) return std::nullopt;
  return vector;
}

/// Whether the name is there; where it is absent, `to` stays as it is. The same holds of the readers below.
base::Result<bool> readVector(Values& values, const std::string& name, glm::dvec3& to) {
  const auto text = values.removeValue(name);
  if (!text) return false;
  const auto vector = parseVector(*text);
  if (!vector) return wrongRender(name + " must be three numbers x,y,z within 1e12");
  to = *vector;
  return true;
}

base::Result<void> readNumber(Values& values, const std::string& name, double above, double most, double& to) {
  const auto text = values.removeValue(name);
  if (!text) return {};
  const auto number = base::parseNumber(*text);
  if (!number || !(*number > above) || *number > most)
    return wrongRender(name + base::formatText(" must be a number above %g and at most %g", above, most));
  to = *number;
  return {};
}

base::Result<void> readInteger(Values& values, const std::string& name, int least, int most, int& to) {
  const auto text = values.removeValue(name);
  if (!text) return {};
  const auto number = base::parseNumber(*text);
  if (!number || *number < least || *number > most || *number != std::floor(*number))
    return wrongRender(name + " must be a whole number from " + std::to_string(least) + " to " + std::to_string(most));
  to = static_cast<int>(*number);
  return {};
}

bool canBeUnit(const glm::dvec3& v) {
  const double length = glm::length(v);
  return std::isfinite(length) && length > 1e-12;
}

base::Result<void> readCamera(Values& values, base::ViewCamera& camera) {
  LUMIGRID_ASSIGN_OR_RETURN(auto position, readVector(values, "position", camera.position));
  if (!position) return wrongRender("position=x,y,z is needed");
  glm::dvec3 target(0.0);
  LUMIGRID_ASSIGN_OR_RETURN(auto by_target, readVector(values, "target", target));
  LUMIGRID_ASSIGN_OR_RETURN(auto by_direction, readVector(values, "direction", camera.direction));
  if (by_target == by_direction) return wrongRender("either direction=x,y,z or target=x,y,z is needed");
  if (by_target) camera.direction = target - camera.position;
  if (auto up = readVector(values, "up", camera.up); !up) return up.error();
  if (!canBeUnit(camera.direction)) return wrongRender("the direction has no length");
  if (!canBeUnit(camera.up)) return wrongRender("up has no length");
  camera.direction = glm::normalize(camera.direction);
  camera.up = glm::normalize(camera.up);
  if (glm::length(glm::cross(camera.direction, camera.up)) < kMinSine)
    return wrongRender("up must not be parallel to the direction");
  return {};
}

base::Result<void> readFov(Values& values, base::ViewCamera& camera) {
  auto radians = values.removeValue("fov_y");
  if (!radians) {
    double degrees = 45.0;
    LUMIGRID_TRY(readNumber(values, "fov_y_degrees", kMinFovDegrees, kMaxFovDegrees, degrees));
    camera.fov_y = glm::radians(degrees);
    return {};
  }
  if (values.removeValue("fov_y_degrees"))
    return wrongRender("fov_y (radians) and fov_y_degrees say the same; give one of them");
  const auto number = base::parseNumber(*radians);
  if (!number || !(*number > glm::radians(kMinFovDegrees)) || *number > glm::radians(kMaxFovDegrees))
    return wrongRender("fov_y must be an angle in radians above 0.0009 and at most 3.139");
  camera.fov_y = *number;
  return {};
}

base::Result<void> readSize(Values& values, std::uint64_t max_pixels, base::ViewCamera& camera) {
  LUMIGRID_TRY(readInteger(values, "width", 1, kMaxSide, camera.width));
  LUMIGRID_TRY(readInteger(values, "height", 1, kMaxSide, camera.height));
  const std::uint64_t pixels = static_cast<std::uint64_t>(camera.width) * static_cast<std::uint64_t>(camera.height);
  if (pixels > max_pixels)
    return wrongRender(std::to_string(camera.width) + " x " + std::to_string(camera.height) +
                       " pixels are too many; this server draws at most " + std::to_string(max_pixels));
  return {};
}

base::Result<void> readFormat(Values& values, const std::optional<Rgb>& background, PictureRequest& request) {
  const std::string format = values.removeValue("format").value_or("png");
  if (format != "png" && format != "jpeg") return wrongRender("format must be png or jpeg");
  if (format == "jpeg") {
    request.format = PictureRequest::Format::kJpeg;
    request.background = background.value_or(kWhite);
  }
  return readInteger(values, "quality", 1, 100, request.quality);
}

base::Result<void> readBackground(Values& values, PictureRequest& request) {
  const auto text = values.removeValue("background");
  if (!text) return {};
  if (*text == "transparent") {
    if (request.format == PictureRequest::Format::kJpeg)
      return wrongRender("a JPEG cannot be transparent; take format=png or a background=rrggbb");
    request.background.reset();
    return {};
  }
  if (text->size() != 6 || text->find_first_not_of("0123456789abcdefABCDEF") != std::string::npos)
    return wrongRender("background must be transparent or six hexadecimal digits rrggbb");
  const unsigned long value = std::stoul(*text, nullptr, 16);
  request.background = Rgb{static_cast<std::uint8_t>(value >> 16), static_cast<std::uint8_t>(value >> 8 & 0xFF),
                           static_cast<std::uint8_t>(value & 0xFF)};
  return {};
}

/// Reads "x,120.5,b": an axis, an offset, and whether the part below or above it is kept, as in a permalink.
std::optional<base::SectionPlane> parseSection(std::string_view text) {
  if (text.size() < 5 || text[1] != ',' || text[text.size() - 2] != ',') return std::nullopt;
  const int axis = text.front() - 'x';
  const char kept = text.back();
  const double offset = base::parseNumber(text.substr(2, text.size() - 4)).value_or(std::nan(""));
  if (axis < 0 || axis > 2 || (kept != 'a' && kept != 'b')) return std::nullopt;
  if (!(std::abs(offset) <= protocol::kMaxCoordinate)) return std::nullopt;
  const double side = kept == 'b' ? 1.0 : -1.0;
  base::SectionPlane plane;
  plane.normal = glm::dvec3(0.0);
  plane.normal[axis] = side;
  plane.offset = side * offset;
  return plane;
}

base::Result<void> readSection(Values& values, PictureRequest& request) {
  const auto text = values.removeValue("section");
  if (!text) return {};
  request.camera.section = parseSection(*text);
  if (!request.camera.section)
    return wrongRender("section must be an axis, an offset within 1e12, and a or b: x,120.5,b");
  return {};
}

base::Result<void> readLight(Values& values, PictureRequest& request) {
  const auto text = values.removeValue("light");
  if (!text) return {};
  const auto towards = parseVector(*text);
  const double length = towards ? glm::length(*towards) : 0.0;
  if (!(length > 0.0) || !std::isfinite(length))
    return wrongRender("light must be a direction other than 0,0,0: x,y,z");
  request.light = *towards / length;
  return {};
}

base::Result<void> readColors(Values& values, PictureRequest& request) {
  const std::string colors = values.removeValue("colors").value_or("scene");
  if (colors != "scene" && colors != "resolution") return wrongRender("colors must be scene or resolution");
  request.resolution_colors = colors == "resolution";
  double tolerance = static_cast<double>(request.tolerance_px);
  LUMIGRID_TRY(readNumber(values, "tolerance", kMinTolerance, kMaxTolerance, tolerance));
  request.tolerance_px = static_cast<float>(tolerance);
  const std::string measure = values.removeValue("measure").value_or("visible");
  if (measure != "visible" && measure != "shape" && measure != "bound")
    return wrongRender("measure must be visible, shape or bound");
  request.measure = measure == "bound"   ? base::ErrorMeasure::kBound
                    : measure == "shape" ? base::ErrorMeasure::kShape
                                         : base::ErrorMeasure::kVisible;
  return {};
}

}  // namespace

const char* contentTypeOf(PictureRequest::Format format) {
  return format == PictureRequest::Format::kPng ? "image/png" : "image/jpeg";
}

base::Subsampling subsamplingFor(int quality) {
  return quality >= 90 ? base::Subsampling::k444 : base::Subsampling::k420;
}

base::Result<PictureRequest> parsePictureRequest(const Query& query, std::uint64_t max_pixels,
                                                 const std::optional<Rgb>& background) {
  Values values(query);
  PictureRequest request;
  LUMIGRID_TRY(readCamera(values, request.camera));
  LUMIGRID_TRY(readFov(values, request.camera));
  LUMIGRID_TRY(readNumber(values, "ortho_height", 0.0, protocol::kMaxCoordinate, request.camera.ortho_height));
  LUMIGRID_TRY(readSize(values, max_pixels, request.camera));
  LUMIGRID_TRY(readFormat(values, background, request));
  LUMIGRID_TRY(readInteger(values, "supersampling", 1, 4, request.supersampling));
  LUMIGRID_TRY(readBackground(values, request));
  LUMIGRID_TRY(readSection(values, request));
  LUMIGRID_TRY(readLight(values, request));
  LUMIGRID_TRY(readColors(values, request));
  if (!values.left().empty())
    return wrongRender(
        "a name is none of position, direction, target, up, fov_y, fov_y_degrees, ortho_height, width, height, "
        "format, quality, supersampling, background, section, light, colors, tolerance, measure");
  return request;
}

// ---- Drawing

base::Result<std::unique_ptr<PicturePainter>> PicturePainter::begin(const PictureRequest& request,
                                                                    const base::Scene& scene,
                                                                    const SceneRenderer& renderer,
                                                                    std::uint64_t band_pixels) {
  std::unique_ptr<PicturePainter> painter(new PicturePainter(request));
  painter->camera_ =
      base::cameraForScene(request.camera, scene.origin, {renderer.sceneCenter(), renderer.sceneRadius()});
  RenderOptions& options = painter->options_;
  options.tolerance_px = request.tolerance_px;
  options.measure = request.measure;
  options.modes.resolution_colors = request.resolution_colors;
  if (request.light) options.modes.light = glm::vec3(*request.light);
  options.supersampling = request.supersampling;
  const std::uint64_t rows = band_pixels / static_cast<std::uint64_t>(request.camera.width);
  painter->band_height_ =
      static_cast<int>(std::clamp<std::uint64_t>(rows, 1, static_cast<std::uint64_t>(request.camera.height)));
  LUMIGRID_ASSIGN_OR_RETURN(painter->rows_, painter->beginRows());
  return painter;
}

base::Result<std::unique_ptr<base::ImageRows>> PicturePainter::beginRows() {
  if (request_.format == PictureRequest::Format::kPng)
    return base::beginPng(camera_.width, camera_.height, request_.background ? 3 : 4, bytes_);
  return base::beginJpeg(camera_.width, camera_.height, request_.quality, subsamplingFor(request_.quality), bytes_);
}

base::Result<bool> PicturePainter::drawNextBand(SceneRenderer& renderer) {
  const int height = std::min(band_height_, camera_.height - next_row_);
  // The cut depends on the eye and the pixels per unit, which all bands share, so that no seam shows between bands.
  LUMIGRID_ASSIGN_OR_RETURN(auto band,
                            renderer.render(tileCamera(camera_, 0, next_row_, camera_.width, height), options_));
  const base::Image pixels =
      request_.background ? compositeOver(band.rgba, *request_.background) : std::move(band.rgba);
  LUMIGRID_TRY(rows_->add(pixels));
  next_row_ += height;
  return next_row_ == camera_.height;
}

}  // namespace server
