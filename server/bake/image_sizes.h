#pragma once
// Estimates how many bytes the images of sampling points will take, from a few of them that it draws and encodes.
#include <cstdint>
#include <glm/glm.hpp>
#include <memory>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/egl/headless.h"
#include "base/error.h"
#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "repository/sampling/wanted_tiles.h"
#include "server/bake/bake.h"
#include "server/render/scene_renderer.h"

namespace server {

class ImageSizes {
 public:
  /// Draws with a GL context of its own on the thread that calls; nothing else may use that thread's context meanwhile.
  /// All must outlive it. Errors as tuneScene().
  static base::Result<std::unique_ptr<ImageSizes>> create(const base::Scene& scene,
                                                          const lod::patch::PatchFile& patches,
                                                          const BakeOptions& options);
  /// An upper estimate of the bytes that the store's values of all faces at these points take, or of the `wanted` of
  /// their tiles: the true sum is higher in one of forty cases. Exact where no more points are there than it draws. The
  /// same points give the same estimate, and most points that were drawn for one estimate serve for the next when only
  /// some points are gone. Errors: those of drawing and encoding.
  base::Result<std::uint64_t> estimate(const std::vector<glm::uvec3>& points,
                                       const repository::WantedTiles* wanted = nullptr);

 private:
  explicit ImageSizes(const BakeOptions& options) : options_(options) {}
  std::vector<glm::uvec3> sampleOf(std::vector<glm::uvec3> points) const;
  base::Result<void> measure(const std::vector<glm::uvec3>& points);

  /// An image by its key's code, and its bytes.
  using Sizes = std::vector<std::pair<std::uint64_t, std::uint64_t>>;

  const BakeOptions& options_;
  std::unique_ptr<base::HeadlessContext> context_;
  std::unique_ptr<SceneRenderer> renderer_;         // goes before its context
  std::unordered_map<std::uint64_t, Sizes> sizes_;  // of a point's images, by its code
};

}  // namespace server
