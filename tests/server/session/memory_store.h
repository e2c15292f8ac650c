#pragma once
// Holds a repository in memory, and a scene around the synthetic hierarchy: a bumpy square of 32 × 32 units seen from
// above.
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <map>
#include <memory>
#include <string>

#include "repository/faces/face_value.h"
#include "repository/store.h"
#include "server/session/session.h"
#include "tests/support/synthetic_hierarchy.h"

namespace server {

class MemoryStore final : public repository::Store {
 public:
  base::Result<std::optional<base::Bytes>> get(const repository::FaceKey& key) const override {
    const auto it = values.find(key);
    return it == values.end() ? std::nullopt : std::optional(it->second);
  }
  base::Result<std::optional<std::uint64_t>> valueBytes(const repository::FaceKey& key) const override {
    const auto it = values.find(key);
    return it == values.end() ? std::nullopt : std::optional<std::uint64_t>(it->second.size());
  }
  base::Result<void> putBatch(const std::vector<std::pair<repository::FaceKey, base::Bytes>>& batch) override {
    for (const auto& [key, value] : batch) values[key] = value;
    return {};
  }
  base::Result<void> erase(const std::vector<repository::FaceKey>& keys) override {
    for (const auto& key : keys) values.erase(key);
    return {};
  }
  base::Result<void> forEach(
      const std::function<bool(const repository::FaceKey&, base::ByteView)>& visit) const override {
    for (const auto& [key, value] : values)
      if (!visit(key, value)) break;
    return {};
  }
  base::Result<std::uint64_t> size() const override { return values.size(); }
  base::Result<std::optional<std::string>> readMeta() const override { return std::optional<std::string>(); }
  base::Result<void> writeMeta(const std::string&) override { return {}; }
  base::Error readOnlyError() const override { return {}; }

  std::map<repository::FaceKey, base::Bytes> values;
};

/// A face value of about `bytes` bytes; its picture does not matter to a server.
inline base::Bytes someFaceValue(std::size_t bytes, std::uint8_t fill) {
  const base::Bytes jpeg(bytes, fill);
  return repository::encodeFaceValue({.empty = false, .picture = jpeg, .coverage = {}});
}

/// `n` is that of syntheticHierarchy. Every face of an 8 × 8 × 8 grid around the square holds `face_bytes` bytes.
struct TestScene {
  explicit TestScene(int n = 8, std::size_t face_bytes = 20'000) {
    static std::atomic<int> counter{0};
    const auto name = "lumigrid_session_test_" + std::to_string(::getpid()) + "_" + std::to_string(counter++) + ".lgp";
    path = (std::filesystem::temp_directory_path() / name).string();
    const auto synthetic = support::syntheticHierarchy(n);
    LUMIGRID_CHECK(bool(support::writeSynthetic(synthetic, path)));
    auto opened = lod::patch::PatchFile::open(path);
    LUMIGRID_CHECK(bool(opened));
    patches = std::make_unique<lod::patch::PatchFile>(std::move(*opened));

    const base::Aabb box = boundsOf(patches->hierarchy());
    data.patches = patches.get();
    data.images = &store;
    data.welcome.scene_name = "synthetic";
    data.welcome.box_min = box.min;
    data.welcome.box_max = box.max;
    data.welcome.group_count = static_cast<std::uint32_t>(patches->hierarchy().groups.size());
    data.welcome.patch_count = static_cast<std::uint32_t>(patches->hierarchy().patches.size());
    data.welcome.grid = repository::makeGrid(box, 8, 0.5F, 256);
    const glm::uvec3 count = data.welcome.grid.count;
    for (std::uint32_t x = 0; x < count.x; ++x)
      for (std::uint32_t y = 0; y < count.y; ++y)
        for (std::uint32_t z = 0; z < count.z; ++z)
          for (std::uint32_t d = 0; d < 6; ++d)
            store.values[{x, y, z, d}] = someFaceValue(face_bytes, static_cast<std::uint8_t>(x + 8 * y + 64 * z + d));
  }
  ~TestScene() { std::filesystem::remove(path); }
  TestScene(const TestScene&) = delete;
  TestScene& operator=(const TestScene&) = delete;

  static base::Aabb boundsOf(const lod::patch::Hierarchy& hierarchy) {
    base::Aabb box;
    for (const auto& patch : hierarchy.patches) box.add(patch.box);
    return box;
  }
  glm::dvec3 center() const { return 0.5 * glm::dvec3(data.welcome.box_min + data.welcome.box_max); }
  /// Returns a view of `target` from `from`, both relative to the middle of the square in units of its side.
  protocol::View view(std::uint32_t sequence, const glm::dvec3& from,
                      const glm::dvec3& target = glm::dvec3(0.0)) const {
    const double side = static_cast<double>(data.welcome.box_max.x - data.welcome.box_min.x);
    protocol::View v;
    v.sequence = sequence;
    v.camera.position = center() + side * from;
    v.camera.direction = glm::normalize(side * (target - from));
    v.camera.up = glm::dvec3(0.0, 1.0, 0.0);
    v.camera.width = 640;
    v.camera.height = 480;
    v.patch_tolerance_px = 1.0F;
    return v;
  }

  std::string path;
  std::unique_ptr<lod::patch::PatchFile> patches;
  MemoryStore store;
  SceneData data;
};

/// The same with shadows, which only images show, and tiles, of which the coarsest are stored, so large that from afar
/// not all are worth their bytes.
struct FarScene : TestScene {
  FarScene() : TestScene(16, 60'000) {
    data.welcome.shadows = true;
    data.welcome.grid.tile_depth = 1;
    data.welcome.grid.face_size = data.welcome.grid.faceSideAt(1);
  }
  base::ViewCamera camera() const { return view(1, {0.2, 0.1, 3.0}).camera; }
};

/// The scene of a server that renders frames.
inline TestScene& withFrames(TestScene& scene) {
  scene.data.welcome.can_render_frames = true;
  return scene;
}

}  // namespace server
