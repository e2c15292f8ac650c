// scene.json is fetched by `serve`, `verify` and viewers from hosts of others.
#include <string>

#include "base/check.h"
#include "base/json/scene_file.h"
#include "tests/fuzz/fuzz.h"

namespace fuzz {

std::vector<base::Bytes> seeds() {
  base::Scene scene;
  const std::string empty = base::formatScene(scene);
  scene.sources.push_back({"a.ply", 12, "ab"});
  scene.box_min = {500000.125, 4000000.25, -3};
  scene.box_max = {500010.5, 4000020.75, 7};
  scene.origin = {500005, 4000010, 2};
  scene.repairs["welded_vertices"] = 4;
  scene.parameters["grid"] = "12";
  scene.parts.push_back({"patch-0123456789abcdef0123456789abcdef.lgp", 77, "cd", {{0, 10}, {20, 7}}});
  scene.hull = {{500000.125, 4000000.25, -3}, {500010.5, 4000020.75, 7}};
  scene.north = 12.0;
  scene.crs = "EPSG:32718";
  scene.attribution = "A. Nonymous";
  scene.background = base::Rgb{1, 2, 3};
  scene.images_light = base::Light{base::LightMode::kSoftShadows, {0, 0.6F, 0.8F}, glm::dvec3(1, 2, 3), 0.25};
  const std::string full = base::formatScene(scene);
  return {{empty.begin(), empty.end()}, {full.begin(), full.end()}};
}

void fuzzOne(base::ByteView bytes) {
  const auto scene = base::parseScene(std::string(base::textOf(bytes)), "scene.json");
  if (!scene) {
    LUMIGRID_CHECK(scene.error().message.find('\n') == std::string::npos);
    return;
  }
  // An accepted scene can be written, and reads back unchanged.
  const std::string text = base::formatScene(*scene);
  const auto again = base::parseScene(text, "again");
  LUMIGRID_CHECK(bool(again));
  LUMIGRID_CHECK(base::formatScene(*again) == text);
  (void)base::northOf(*scene);
  (void)base::patchPath("place", *scene);
  for (const base::StreamedMethod& method : base::kStreamedMethods) (void)base::streamedPath("place", *scene, method);
}

}  // namespace fuzz
