#include "client/web/web_scene.h"

#include <emscripten/emscripten.h>

#include <optional>

#include "base/bytes.h"

// The page calls takeParameters() before this returns, when the text holds a grid.
EM_JS(void, lumigridParameters, (const char* text), { Module.readParameters(UTF8ToString(text)); });

namespace client {
namespace {

std::optional<base::Result<repository::SampledPoints>> parameters;

base::Error badParameters() {
  return {base::ErrorCode::kInvalidInput, "hold no valid grid; publish the scene again"};
}

/// Encodes and decodes the grid, since decoding checks its values.
base::Result<repository::Grid> gridOf(const double* n) {
  repository::Grid grid;
  grid.first = glm::vec3(static_cast<float>(n[0]), static_cast<float>(n[1]), static_cast<float>(n[2]));
  grid.spacing = static_cast<float>(n[3]);
  for (int i = 4; i < 8; ++i)
    if (!(n[i] >= 0.0 && n[i] <= 4294967295.0)) return badParameters();
  for (int axis = 0; axis < 3; ++axis) grid.count[axis] = static_cast<std::uint32_t>(n[4 + axis]);
  grid.face_size = static_cast<std::uint32_t>(n[7]);
  base::ByteWriter out;
  grid.encode(out);
  base::ByteReader in(out.view());
  return repository::Grid::decode(in);
}

base::Result<repository::SampledPoints> pointsOf(const double* numbers, const std::string& tree_digits) {
  LUMIGRID_ASSIGN_OR_RETURN(auto grid, gridOf(numbers));
  repository::SampledPoints points{grid, std::nullopt};
  if (tree_digits.empty()) return points;
  const auto bytes = base::bytesOfHex(tree_digits);
  if (!bytes) return badParameters();
  LUMIGRID_ASSIGN_OR_RETURN(auto tree, repository::SampleTree::decode(grid, *bytes));
  points.tree = std::move(tree);
  return points;
}

base::Result<repository::SampledPoints> readParameters(const std::string& text) {
  parameters.reset();
  lumigridParameters(text.c_str());
  return parameters ? *std::exchange(parameters, std::nullopt) : badParameters();
}

StaticScene sceneOf(const std::string& place, const std::string& name, const std::string& units,
                    const std::string& patches, const std::string& index, const double* n) {
  StaticScene scene;
  scene.place = place;
  scene.welcome = welcomeOf(name, units, n);
  scene.patches = {patches, static_cast<std::uint64_t>(n[kWelcomeNumbers])};
  if (n[kWelcomeNumbers + 1] > 0.0)
    scene.index = StaticObject{index, static_cast<std::uint64_t>(n[kWelcomeNumbers + 1])};
  return scene;
}

}  // namespace

WebScene::WebScene(const std::string& place, const std::string& name, const std::string& units,
                   const std::string& patches, const std::string& index, const double* numbers)
    : source_(sceneOf(place, name, units, patches, index, numbers), fetcher_, readParameters) {}

}  // namespace client

extern "C" {

/// Takes the parameters: first (3), spacing, count (3), face size; and the tree's hexadecimal digits, empty where the
/// whole grid is sampled.
EMSCRIPTEN_KEEPALIVE void takeParameters(const double* numbers, const char* tree) {
  client::parameters = client::pointsOf(numbers, tree);
}

}  // extern "C"
