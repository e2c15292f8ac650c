// Measures the CPU time of planning for viewers who move over a served scene: planView and planMotion, as sessions call
// them, with the sizes of stored images from the store.
//
//   plan_bench SCENE [--views N] [--points N] [--rounds N] [--cached 0|1]
//
// Viewers go once around the scene, and fly low over it; one kind has nothing of what is planned, another has all that
// was planned for the views before. A row tells the milliseconds of a kind of plan: median, 99th percentile, mean, and
// a hash of all that was planned, by which two versions of this program can be compared. The first round meets empty
// caches. With --cached 0 lines of sight are not remembered.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <string>
#include <unordered_set>
#include <vector>

#include "plan/view_plan.h"
#include "repository/faces/face_value.h"
#include "server/scene/open_scene.h"
#include "tests/bench/bench.h"

namespace {

using Cameras = std::vector<base::ViewCamera>;

glm::dvec3 upright(const glm::dvec3& up) {
  return std::abs(up.z) > 0.5 ? glm::dvec3(1.0, 0.0, 0.0) : glm::dvec3(0.0, 0.0, 1.0);
}

/// Two directions that stand on `up` and on each other.
struct Ground {
  glm::dvec3 along, across;
  explicit Ground(const glm::dvec3& up) : along(glm::normalize(glm::cross(up, upright(up)))) {
    across = glm::cross(up, along);
  }
  glm::dvec3 at(double angle) const { return std::cos(angle) * along + std::sin(angle) * across; }
};

base::ViewCamera cameraAt(const glm::dvec3& position, const glm::dvec3& target, const glm::dvec3& up) {
  base::ViewCamera camera;
  camera.position = position;
  camera.direction = glm::normalize(target - position);
  camera.up = up;
  return camera;
}

/// Once around the scene, a little above it.
Cameras orbit(const base::Scene& scene, std::size_t count) {
  const glm::dvec3 middle = 0.5 * (scene.box_min + scene.box_max);
  const double size = glm::length(scene.box_max - scene.box_min);
  const glm::dvec3 up = glm::normalize(scene.up);
  const Ground ground(up);
  Cameras cameras;
  for (std::size_t i = 0; i < count; ++i) {
    const double angle = 2.0 * std::numbers::pi * static_cast<double>(i) / static_cast<double>(count);
    cameras.push_back(cameraAt(middle + size * (0.5 * ground.at(angle) + 0.25 * up), middle, up));
  }
  return cameras;
}

/// An eight through the scene's box, near its surface.
Cameras flight(const base::Scene& scene, std::size_t count) {
  const glm::dvec3 middle = 0.5 * (scene.box_min + scene.box_max);
  const glm::dvec3 extent = scene.box_max - scene.box_min;
  const glm::dvec3 up = glm::normalize(scene.up);
  const Ground ground(up);
  const double height = std::abs(glm::dot(extent, up));
  const double size = glm::length(extent);
  const auto placeAt = [&](double t) {
    const double angle = 2.0 * std::numbers::pi * t;
    return middle + 0.3 * size * (std::sin(angle) * ground.along + 0.5 * std::sin(2.0 * angle) * ground.across) +
           (0.5 * height + 0.03 * size) * up;
  };
  Cameras cameras;
  for (std::size_t i = 0; i < count; ++i) {
    const double t = static_cast<double>(i) / static_cast<double>(count);
    cameras.push_back(cameraAt(placeAt(t), placeAt(t + 0.05) - 0.06 * size * up, up));
  }
  return cameras;
}

/// Bytes of stored images, as server::Session asks for them.
plan::StoredBytes storedBytesOf(const server::SceneData& data) {
  return [images = data.images](const repository::FaceKey& key) -> std::optional<std::uint64_t> {
    const auto bytes = images->valueBytes(key);
    if (!bytes || (*bytes && **bytes == 0)) return std::nullopt;
    return *bytes && **bytes > repository::kImageHeaderBytes ? **bytes : 0;
  };
}

class Hash {
 public:
  void add(std::uint64_t value) { hash_ = (hash_ ^ value) * 0x9E3779B97F4A7C15U, hash_ ^= hash_ >> 29; }
  void add(const std::vector<repository::FaceKey>& faces) {
    for (const repository::FaceKey& key : faces) add(key.code());
  }
  void add(const plan::ViewPlan& plan) {
    for (const std::uint32_t group : plan.groups) add(group);
    for (const std::size_t before : plan.faces_before) add(before);
    for (const glm::uvec3& point : plan.points) add(repository::codeOfPoint(point));
    add(plan.faces), add(plan.other_faces);
  }
  std::uint64_t value() const { return hash_; }

 private:
  std::uint64_t hash_ = 0;
};

struct Times {
  std::vector<double> milliseconds;
  Hash hash;

  template <class Plan>
  auto measure(const Plan& plan) {
    const double start = bench::seconds(CLOCK_THREAD_CPUTIME_ID);
    auto made = plan();
    milliseconds.push_back(1e3 * (bench::seconds(CLOCK_THREAD_CPUTIME_ID) - start));
    hash.add(made);
    return made;
  }
  void print(const std::string& what) {
    std::sort(milliseconds.begin(), milliseconds.end());
    double sum = 0.0;
    for (const double time : milliseconds) sum += time;
    const double count = static_cast<double>(milliseconds.size());
    std::printf("%-38s p50 %6.3f  p99 %6.3f  mean %6.3f ms  %016llx\n", what.c_str(),
                milliseconds[milliseconds.size() / 2], milliseconds[(milliseconds.size() * 99) / 100], sum / count,
                static_cast<unsigned long long>(hash.value()));
  }
};

void measure(const std::string& what, const plan::Scene& scene, const Cameras& cameras, std::uint16_t points,
             bool holds) {
  std::vector<bool> groups(scene.hierarchy->groups.size(), false);
  std::unordered_set<repository::FaceKey> faces;
  const plan::Holdings holdings{[&](const repository::FaceKey& key) { return faces.count(key) != 0; },
                                [&](std::uint32_t group) { return static_cast<bool>(groups[group]); }};
  Times view_times, motion_times;
  protocol::View previous;
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    protocol::View view;
    view.sequence = static_cast<std::uint32_t>(i + 1);
    view.camera = cameras[i];
    view.max_points = points;
    const auto plan = view_times.measure([&] { return plan::planView(scene, view, holdings); });
    if (holds) {
      for (const std::uint32_t group : plan.groups) groups[group] = true;
      faces.insert(plan.faces.begin(), plan.faces.end());
    }
    if (i != 0) motion_times.measure([&] { return plan::planMotion(scene, view, previous, holdings); });
    previous = view;
  }
  view_times.print(what + ", planView");
  motion_times.print(what + ", planMotion");
}

/// The mean expected error of pictures, once all that `planned` plans has come, as `judge` sees it.
double expectedError(const plan::Scene& planned, const plan::Scene& judge, const Cameras& cameras,
                     std::uint16_t points) {
  double sum = 0.0;
  for (const base::ViewCamera& camera : cameras) {
    protocol::View view;
    view.camera = camera;
    view.max_points = points;
    const plan::ViewPlan plan = plan::planView(planned, view);
    const std::unordered_set<std::uint32_t> groups(plan.groups.begin(), plan.groups.end());
    const std::unordered_set<repository::FaceKey> faces(plan.faces.begin(), plan.faces.end());
    const plan::Holdings came{[&](const repository::FaceKey& key) { return faces.count(key) != 0; },
                              [&](std::uint32_t group) { return groups.count(group) != 0; }};
    sum += static_cast<double>(plan::planView(judge, view, came).error_before);
  }
  return sum / static_cast<double>(cameras.size());
}

/// Prints what pictures are expected to lose when lines of sight are remembered by cells.
void compareErrors(const std::string& what, const plan::Scene& scene, const Cameras& cameras, std::uint16_t points) {
  plan::Scene exact = scene;
  exact.sight_cache = nullptr;
  const double with_exact = expectedError(exact, exact, cameras, points);
  const double with_cache = expectedError(scene, exact, cameras, points);
  std::printf("%s: expected %.3f dB by exact lines of sight, %.3f dB by remembered ones\n", what.c_str(),
              -10.0 * std::log10(with_exact), -10.0 * std::log10(with_cache));
}

/// Samples' lines of sight to points around the eye.
void measureLines(const lod::patch::ProxySight& sight, const repository::Grid& grid, const plan::Scene& scene,
                  const Cameras& cameras) {
  std::size_t lines = 0, blocked = 0;
  double time = 0.0;
  for (const base::ViewCamera& viewed : cameras) {
    protocol::View view;
    view.camera = viewed;
    const base::Camera camera = plan::cutRequestFor(*scene.welcome, view).camera;
    const auto samples = plan::sampleVisibleSurface(sight, camera);
    const double start = bench::seconds(CLOCK_THREAD_CPUTIME_ID);
    for (const glm::uvec3& corner : grid.cellCorners(camera.eye))
      for (const plan::SurfaceSample& sample : samples) {
        const glm::vec3 point = grid.point(corner.x, corner.y, corner.z);
        blocked += sight.isBlocked(sample.position, point, 0.5F * sight.error()) ? 1 : 0;
        ++lines;
      }
    time += bench::seconds(CLOCK_THREAD_CPUTIME_ID) - start;
  }
  std::printf("%zu triangles: %.3f us a line of sight, %.0f %% blocked\n", sight.triangleCount(),
              1e6 * time / static_cast<double>(std::max<std::size_t>(1, lines)),
              100.0 * static_cast<double>(blocked) / static_cast<double>(std::max<std::size_t>(1, lines)));
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments given(argc, argv, "SCENE [--views 1..100000] [--points 1..64] [--rounds 1..1000] [--cached 0|1]");
  const auto views = given.number<std::size_t>("--views", 200U, 2U, 100'000U);
  const auto points = given.number<std::uint16_t>("--points", 8U, 1U, 64U);
  const auto rounds = given.number<std::size_t>("--rounds", 2U, 1U, 1000U);
  const bool is_cached = given.number("--cached", 1U, 0U, 1U) != 0;
  given.finish();
  if (given.input().empty()) given.wrong();
  const auto open = bench::must(server::openScene(given.input()));
  const server::SceneData& data = open->data;
  plan::Scene scene = data.toPlan();
  if (data.images != nullptr) scene.stored_bytes = storedBytesOf(data);
  scene.is_fast = true;
  if (!is_cached) scene.sight_cache = nullptr;
  std::printf("%zu groups, %zu patches, %llu points\n", scene.hierarchy->groups.size(), scene.hierarchy->patches.size(),
              static_cast<unsigned long long>(open->points.count()));
  const Cameras around = orbit(open->scene, views);
  const Cameras low = flight(open->scene, views);
  for (std::size_t round = 1; round <= rounds; ++round)
    for (const bool holds : {false, true}) {
      const std::string what = std::to_string(round) + (holds ? ", all came, " : ", nothing came, ");
      measure(what + "orbit", scene, around, points, holds);
      measure(what + "flight", scene, low, points, holds);
    }
  if (scene.sight_cache != nullptr) {
    compareErrors("orbit", scene, around, points);
    compareErrors("flight", scene, low, points);
  }
  if (scene.sight != nullptr) measureLines(*scene.sight, data.welcome.grid, scene, low);
  return 0;
}
