#pragma once
// A scene directory with the synthetic hierarchy and a small repository, and a server of it on a thread.
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

#include "base/json/scene_file.h"
#include "repository/faces/face_value.h"
#include "repository/sampling/grid.h"
#include "repository/store.h"
#include "server/net/server.h"
#include "tests/support/synthetic_hierarchy.h"

namespace server {

inline std::string metaOf(const repository::Grid& grid) {
  std::ostringstream text;
  text << "{\"grid\": {\"first\": [" << grid.first.x << ", " << grid.first.y << ", " << grid.first.z
       << "], \"spacing\": " << grid.spacing << ", \"count\": [" << grid.count.x << ", " << grid.count.y << ", "
       << grid.count.z << "], \"face_size\": " << grid.face_size << "}}";
  return text.str();
}

/// A scene directory that is removed with the object.
class SceneDirectory {
 public:
  /// With 0 `face_bytes` there is no repository.
  explicit SceneDirectory(std::size_t face_bytes = 2'000) {
    static std::atomic<int> counter{0};
    const auto name = "lumigrid_net_test_" + std::to_string(::getpid()) + "_" + std::to_string(counter++);
    path = (std::filesystem::temp_directory_path() / name).string();
    std::filesystem::create_directories(path);

    const auto synthetic = support::syntheticHierarchy(8);
    LUMIGRID_CHECK(bool(support::writeSynthetic(synthetic, path + "/patch.lgp")));
    base::Aabb box;
    for (const auto& patch : synthetic.hierarchy.patches) box.add(patch.box);
    base::Scene scene;
    scene.units = "m";
    scene.origin = {500'000.0, 4'000'000.0, 100.0};
    scene.box_min = scene.origin + glm::dvec3(box.min);
    scene.box_max = scene.origin + glm::dvec3(box.max);
    scene.triangles = synthetic.hierarchy.source_triangles;
    LUMIGRID_CHECK(bool(base::writeSceneFile(scene, path + "/scene.json")));
    if (face_bytes != 0) fill(repository::makeGrid(box, 4, 0.5F, 64), face_bytes);
  }
  ~SceneDirectory() { std::filesystem::remove_all(path); }
  SceneDirectory(const SceneDirectory&) = delete;
  SceneDirectory& operator=(const SceneDirectory&) = delete;

  std::string path;

 private:
  void fill(const repository::Grid& grid, std::size_t face_bytes) const {
    auto store = repository::openLmdbStore(path + "/images", repository::StoreMode::kWrite);
    LUMIGRID_CHECK(bool(store));
    LUMIGRID_CHECK(bool((*store)->writeMeta(metaOf(grid))));
    const base::Bytes jpeg(face_bytes, 0xAB);
    const base::Bytes value = repository::encodeFaceValue({.empty = false, .picture = jpeg, .coverage = {}});
    std::vector<std::pair<repository::FaceKey, base::Bytes>> batch;
    for (const glm::uvec3& p : repository::pointsInMortonOrder(grid))
      for (std::uint32_t d = 0; d < 6; ++d) batch.push_back({{p.x, p.y, p.z, d}, value});
    LUMIGRID_CHECK(bool((*store)->putBatch(batch)));
  }
};

/// A server that runs as long as the object lives.
class RunningServer {
 public:
  explicit RunningServer(const std::string& directory, const ServerOptions& options = quiet())
      : RunningServer(std::vector<std::string>{directory}, options) {}
  explicit RunningServer(const std::vector<std::string>& directories, ServerOptions options = quiet()) {
    options.port = 0;
    auto opened = Server::open(directories, options);
    server = std::move(*opened);
    server->onReload({.at_once = {}, .read_places = [this] {
                        ++reloads_;
                        return std::nullopt;
                      }});
    thread = std::thread([this] { std::ignore = server->run(false); });
  }
  ~RunningServer() { stop(); }
  RunningServer(const RunningServer&) = delete;
  RunningServer& operator=(const RunningServer&) = delete;
  void stop() {
    if (!thread.joinable()) return;
    server->stop();
    thread.join();
  }
  /// Requests that are sent afterwards are answered by what the files say now. The files are read by one thread, so
  /// they were read once when it begins to read them again.
  void reload() {
    const int wanted = reloads_ + 2;
    server->reload();
    server->reload();
    while (reloads_ < wanted) std::this_thread::yield();
  }
  static ServerOptions quiet() {
    ServerOptions options;
    options.render_frames = false;
    return options;
  }
  /// As quiet(), for anybody and from any page.
  static ServerOptions open() {
    ServerOptions options = quiet();
    options.access.is_open = true;
    return options;
  }
  std::uint16_t port() const { return server->port(); }

  std::unique_ptr<Server> server;
  std::thread thread;

 private:
  std::atomic<int> reloads_{0};
};

/// Looks down on the middle of the scene.
inline protocol::View viewOf(const protocol::Welcome& welcome, std::uint32_t sequence) {
  protocol::View view;
  view.sequence = sequence;
  view.camera.position =
      welcome.origin + glm::dvec3(0.5F * (welcome.box_min + welcome.box_max)) + glm::dvec3(0.0, 0.0, 20.0);
  view.camera.direction = {0.0, 0.0, -1.0};
  view.camera.width = 320;
  view.camera.height = 240;
  return view;
}

}  // namespace server
