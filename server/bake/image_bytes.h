#pragma once
// Estimates how many bytes the images of sampling points will take, from a few of them that it draws and encodes
// (`build --views --budget`).
#include <cstdint>
#include <memory>
#include <unordered_map>
#include <vector>

#include "base/egl/headless.h"
#include "base/error.h"
#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "server/bake/bake.h"
#include "server/render/scene_renderer.h"

namespace server {

/// Points that an estimate draws at most: 384 faces, which take some seconds with software GL.
inline constexpr std::size_t kEstimatePoints = 64;

/// Draws with a GL context of its own on the thread that calls; nothing else may use that thread's context meanwhile.
class ImageBytes {
 public:
  /// All must outlive it. Errors as tuneScene().
  static base::Result<std::unique_ptr<ImageBytes>> create(const base::Scene& scene,
                                                          const lod::patch::PatchFile& patches,
                                                          const BakeOptions& options);
  /// An upper estimate of the bytes that the store's values of all faces at these points take: the true sum is higher
  /// in one of forty cases. Exact for up to kEstimatePoints points. The same points give the same estimate, and most
  /// points that were drawn for one estimate serve for the next when only some points are gone. Errors: those of
  /// drawing and encoding.
  base::Result<std::uint64_t> estimate(const std::vector<glm::uvec3>& points);

 private:
  ImageBytes(const BakeOptions& options) : options_(options) {}
  base::Result<void> measure(const std::vector<glm::uvec3>& points);

  const BakeOptions& options_;
  std::unique_ptr<base::HeadlessContext> context_;
  std::unique_ptr<SceneRenderer> renderer_;                 // goes before its context
  std::unordered_map<std::uint64_t, std::uint64_t> bytes_;  // bytes of a point's six faces, by its code
};

}  // namespace server
