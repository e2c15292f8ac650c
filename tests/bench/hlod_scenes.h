#pragma once
// A scene's nodes of triangles and points for benches: what a cut costs, which tolerance costs as much, and the surface
// that it draws.
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/egl/headless.h"
#include "base/json/scene_file.h"
#include "lod/hlod/stream.h"
#include "server/render/hlod_scene.h"
#include "server/render/streamed_scene.h"
#include "tests/bench/bench.h"
#include "tests/support/surface_distance.h"

namespace bench {

/// The scene in `directory` in the light of another, since the best light is guessed from what a scene was built with.
inline base::Scene litAs(const base::Scene& other, const std::string& directory) {
  base::Scene scene = must(base::readScene(directory));
  scene.light = other.light;
  return scene;
}

/// Pixels of a picture.
struct PictureSize {
  int width = 0, height = 0;
};

/// Looks at the model's middle from so many of its radii away. `turn`, `pitch`: radians around z and above the ground.
inline base::Camera orbitCamera(const base::Sphere& bounds, double turn, double pitch, double radii,
                                const PictureSize& size) {
  const glm::dvec3 away(std::cos(turn) * std::cos(pitch), std::sin(turn) * std::cos(pitch), std::sin(pitch));
  base::ViewCamera at;
  at.position = glm::dvec3(bounds.center) + radii * static_cast<double>(bounds.radius) * away;
  at.direction = -away;
  at.up = {0, 0, 1};
  at.width = size.width;
  at.height = size.height;
  return base::cameraForScene(at, glm::dvec3(0.0), bounds);
}

/// Reads the hlod.lgh of a scene, whole.
class NodeFile {
 public:
  explicit NodeFile(const std::string& directory)
      : opened_(must(server::openStreamedFile(directory, must(base::readScene(directory)), base::kHlodMethod))),
        stream_(opened_.bytes, server::wholeFile<lod::hlod::StreamOptions>()) {
    must(server::checkStream(stream_, opened_.path));
  }

  /// The cut of a camera at a tolerance in pixels.
  std::vector<std::uint32_t> cut(const base::Camera& camera, float tolerance) const {
    lod::hlod::TraverseRequest request;
    request.camera = camera;
    request.tolerance = tolerance;
    return lod::hlod::chooseCut(stream_.nodes(), request);
  }

  /// Triangles and points together of the nodes in view.
  std::uint64_t primitives(const base::Camera& camera, float tolerance) const {
    std::uint64_t sum = 0;
    for (const std::uint32_t node : cut(camera, tolerance))
      sum += stream_.nodes()[node].triangles + stream_.nodes()[node].points;
    return sum;
  }

  /// The largest tolerance, to a hundredth of itself, whose cut has at least so many primitives; 1e-3 where none has.
  float toleranceFor(const base::Camera& camera, std::uint64_t primitives_wanted) const {
    float low = 1e-3F, high = 1e3F;
    if (primitives(camera, low) < primitives_wanted) return low;
    while (high > 1.01F * low) {
      const float middle = std::sqrt(low * high);
      (primitives(camera, middle) >= primitives_wanted ? low : high) = middle;
    }
    return low;
  }

  /// The triangles of the nodes in view, scene-local. A point is a triangle without extent.
  support::Surface surface(const base::Camera& camera, float tolerance, bool cull = true) {
    lod::hlod::TraverseRequest request;
    request.camera = camera;
    request.tolerance = tolerance;
    request.cull = cull;
    std::vector<lod::hlod::DrawnNode> drawn;
    stream_.update(request, drawn);
    must(server::checkStream(stream_, opened_.path));
    support::Surface surface;
    for (const lod::hlod::DrawnNode& node : drawn) append(*node.picture, surface);
    return surface;
  }

 private:
  static void append(const lod::hlod::NodePicture& picture, support::Surface& surface) {
    const auto first = static_cast<std::uint32_t>(surface.positions.size());
    for (const lod::SurfaceVertex& vertex : picture.vertices) surface.positions.push_back(vertex.position);
    for (const std::uint32_t v : picture.triangles) surface.indices.push_back(first + v);
    for (std::uint32_t v = first; v < first + picture.points; ++v) surface.indices.insert(surface.indices.end(), 3, v);
  }

  const server::OpenStreamedFile opened_;
  lod::hlod::Stream stream_;
};

}  // namespace bench
