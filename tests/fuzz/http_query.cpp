// Requests of visitors for /render and /pick: any target, and any values of the header fields that are read.
#include <cmath>
#include <string>

#include "base/check.h"
#include "server/net/http_text.h"
#include "server/net/page_files.h"
#include "server/net/pick.h"
#include "server/net/picture.h"
#include "tests/fuzz/fuzz.h"

namespace fuzz {
namespace {

constexpr std::uint64_t kMaxPixels = 64'000'000;

bool isFinite(const glm::dvec3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

void check(const server::PictureRequest& request) {
  const base::ViewCamera& camera = request.camera;
  LUMIGRID_CHECK(isFinite(camera.position) && isFinite(camera.up));
  LUMIGRID_CHECK(std::abs(glm::length(camera.direction) - 1.0) < 1e-9);
  LUMIGRID_CHECK(glm::length(glm::cross(camera.direction, camera.up)) > 0.0);
  LUMIGRID_CHECK(camera.width >= 1 && camera.height >= 1);
  LUMIGRID_CHECK(static_cast<std::uint64_t>(camera.width) * static_cast<std::uint64_t>(camera.height) <= kMaxPixels);
  LUMIGRID_CHECK(request.quality >= 1 && request.quality <= 100);
}

}  // namespace

std::vector<base::Bytes> seeds() {
  std::vector<base::Bytes> all;
  for (const std::string text :
       {"/render?position=1,2,3&direction=0,1,0&up=0,0,1&fov_y_degrees=45&width=800&height=600&format=jpeg&quality=80",
        "/render?position=5e5,4e6,%2d3&target=0,0,0&ortho_height=2.5&supersampling=1&background=ff8000",
        "/pick?ox=1&oy=-2.5e3&oz=+3&dx=0&dy=0&dz=-1", "gzip;q=0.5, br, *;q=0", "W/\"abc\", \"def\""})
    all.emplace_back(text.begin(), text.end());
  return all;
}

void fuzzOne(base::ByteView bytes) {
  const std::string text(bytes.begin(), bytes.end());
  (void)server::acceptsCoding(text, "br");
  (void)server::namesEntityTag(text, "\"def\"");
  (void)server::isHashedName(text);
  (void)server::isWebSocketKey(text);
  const auto query = server::parseQuery(text);
  if (!query) return;
  const auto picture = server::parsePictureRequest(*query, kMaxPixels);
  if (picture)
    check(*picture);
  else
    LUMIGRID_CHECK(picture.error().message.find('\n') == std::string::npos);
  const auto ray = server::parsePickRequest(*query);
  if (ray) LUMIGRID_CHECK(isFinite(ray->origin) && std::abs(glm::length(ray->direction) - 1.0) < 1e-9);
}

}  // namespace fuzz
