// Shows patches and images, from a server or from a published scene.
#include <emscripten/emscripten.h>

#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "base/bytes.h"
#include "client/source/static_source.h"
#include "client/web/page.h"
#include "client/web/web_fetcher.h"

// The page calls takeParameters() before this returns, when the text holds a grid.
EM_JS(void, lumigridParameters, (const char* text), { Module.readParameters(UTF8ToString(text)); });

namespace client::web {

const Method kPageMethod = Method::kLumigraph;
std::unique_ptr<SurfaceSight> (*const kPageSight)() = makeSurfaceSight;

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
  for (int i = 4; i < 9; ++i)
    if (!(n[i] >= 0.0 && n[i] <= 4294967295.0)) return badParameters();
  for (int axis = 0; axis < 3; ++axis) grid.count[axis] = static_cast<std::uint32_t>(n[4 + axis]);
  grid.face_size = static_cast<std::uint32_t>(n[7]);
  grid.tile_depth = static_cast<std::uint32_t>(n[8]);
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

/// The scene, whose numbers the page's JavaScript read (client/web/site/static_scene.js).
struct PublishedScene {
  explicit PublishedScene(StaticScene values) : source(std::move(values), fetcher, readParameters) {}
  WebFetcher fetcher;
  StaticSource source;
};
std::unique_ptr<PublishedScene> scene;  // null with a server

void pick(const Request& request) {
  scene->source.pick(request.id, request.origin, request.direction);
}

}  // namespace
}  // namespace client::web

extern "C" {

/// Opens a published scene. `numbers`: as in client/web/page.h, the three being the lengths of the patches, of their
/// records and of the index (0: none), and behind the hull, of each of them, the count of the ranges that are read
/// first, then their offsets and lengths.
EMSCRIPTEN_KEEPALIVE void openStatic(const char* place, const char* name, const char* units, const char* start_view,
                                     const char* attribution, const char* patches, const char* records,
                                     const char* index, const double* numbers) {
  const double* bytes = numbers + client::web::kWelcomeNumbers;
  client::StaticScene scene;
  scene.place = place;
  scene.welcome = client::web::welcomeOf(name, units, start_view, attribution, numbers);
  scene.patches = {patches, static_cast<std::uint64_t>(bytes[0])};
  scene.records = {records, static_cast<std::uint64_t>(bytes[1])};
  const double* next = numbers + client::web::kHullAt + 3 * scene.welcome.hull.size();
  client::StaticObject images{index, static_cast<std::uint64_t>(bytes[2])};
  for (client::StaticObject* object : {&scene.patches, &scene.records, &images}) {
    for (auto left = static_cast<int>(*next++); left > 0; --left, next += 2)
      object->opening.push_back({static_cast<std::uint64_t>(next[0]), static_cast<std::uint64_t>(next[1])});
  }
  if (images.bytes > 0) scene.index = std::move(images);
  client::web::scene = std::make_unique<client::web::PublishedScene>(std::move(scene));
  client::web::page.pick = client::web::pick;
}

/// Returns 1 when something arrived.
EMSCRIPTEN_KEEPALIVE int pumpStatic(double now) {
  client::App& app = *client::web::page.app;
  client::StaticSource& source = client::web::scene->source;
  bool came = source.pump(app.session(), now);
  for (const client::AnsweredPick& pick : source.takePicks()) {
    app.answerPick(pick.id, pick.answer);
    came = true;
  }
  return came ? 1 : 0;
}

/// Returns what cannot be shown though the rest goes on; mostly empty.
EMSCRIPTEN_KEEPALIVE const char* staticProblem() {
  return client::web::scene->source.problem().c_str();
}

/// Takes the parameters: first (3), spacing, count (3), face size; and the tree's hexadecimal digits, empty where the
/// whole grid is sampled.
EMSCRIPTEN_KEEPALIVE void takeParameters(const double* numbers, const char* tree) {
  client::web::parameters = client::web::pointsOf(numbers, tree);
}

}  // extern "C"
