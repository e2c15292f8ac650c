// Measures what it costs the server to choose a view's images, with and without the occlusion test.
//
//   choice_bench SCENE VIEWS.json        (lumigrid tour SCENE --random 200 -o VIEWS.json)
//
// It prints the median and the largest number of microseconds that planView (cut, points, faces) takes for a view, and
// those of the occlusion test alone.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <vector>

#include "base/json/camera_file.h"
#include "plan/view_plan.h"
#include "server/scene/open_scene.h"

namespace {

using Clock = std::chrono::steady_clock;

double microsecondsSince(Clock::time_point start) {
  return std::chrono::duration<double, std::micro>(Clock::now() - start).count();
}

void report(const char* what, std::vector<double> times) {
  std::sort(times.begin(), times.end());
  std::printf("%-32s median %8.1f us, worst %8.1f us\n", what, times[times.size() / 2], times.back());
}

void timePlans(const char* what, const server::SceneData& scene, const std::vector<base::ViewCamera>& cameras) {
  std::vector<double> times;
  for (const base::ViewCamera& camera : cameras) {
    protocol::View view;
    view.camera = camera;
    const auto start = Clock::now();
    const plan::ViewPlan plan = plan::planView(scene.toPlan(), view);
    times.push_back(microsecondsSince(start));
  }
  report(what, std::move(times));
}

// Tests sight from every camera to places all over the model.
void timeLines(const lod::patch::ProxySight& sight, const base::Scene& scene,
               const std::vector<base::ViewCamera>& cameras) {
  const glm::vec3 low(scene.box_min - scene.origin);
  const glm::vec3 size(scene.box_max - scene.box_min);
  std::size_t lines = 0, blocked = 0;
  const auto start = Clock::now();
  for (const base::ViewCamera& camera : cameras)
    for (int i = 0; i < 1000; ++i, ++lines) {
      const glm::vec3 to = low + size * glm::vec3(i % 10, i / 10 % 10, i / 100) / 9.0F;
      blocked += sight.isBlocked(to, glm::vec3(camera.position - scene.origin), 0.5F * sight.error()) ? 1 : 0;
    }
  std::printf("%zu triangles (error %g): %.3f us per line of sight, %.0f %% blocked\n", sight.triangleCount(),
              static_cast<double>(sight.error()), microsecondsSince(start) / static_cast<double>(lines),
              100.0 * static_cast<double>(blocked) / static_cast<double>(lines));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "choice_bench SCENE VIEWS.json\n");
    return 2;
  }
  const auto path = base::readCameraPath(argv[2]);
  const auto open = server::openScene(argv[1]);
  if (!path || !open) {
    std::fprintf(stderr, "%s\n", !path ? path.error().message.c_str() : open.error().message.c_str());
    return 1;
  }
  server::SceneData scene = (*open)->data;
  timePlans("planView", scene, path->frames);
  if (scene.sight != nullptr) timeLines(*scene.sight, (*open)->scene, path->frames);
  scene.sight = nullptr;
  timePlans("planView without sight", scene, path->frames);
  return 0;
}
