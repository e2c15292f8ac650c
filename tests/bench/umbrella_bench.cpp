// umbrella_bench MESH [--width W] [--height H] [--views N] [--only table|distance]
// Builds the mesh's patches and its points with umbrellas, and draws both with the server's renderers.
// table: Dey and Hudson 2002, table 2. Views around the model, near and far: frames a second of the full mesh
// and of umbrellas at tolerances 1, 3 and 5, drawn in turn with one sample a pixel and read back, beside what they draw
// and how far their pictures are from the full mesh's, both with 4 × 4 samples a pixel.
// distance: figure 6. How many points and triangles are drawn as the model recedes, a line of CSV for each distance.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "base/egl/headless.h"
#include "compare/accuracy.h"
#include "compare/run.h"
#include "server/render/scene_renderer.h"
#include "server/render/umbrella_scene.h"
#include "tests/bench/bench.h"
#include "tests/bench/build_run.h"

namespace {

using bench::median;
using bench::must;
using bench::seconds;

constexpr int kRuns = 3, kAccurateSamples = 4;
constexpr float kFullMesh = 0.0F;  ///< in place of a tolerance
constexpr std::array kTolerances = {kFullMesh, 1.0F, 3.0F, 5.0F};

struct Drawn {
  base::Image rgba;
  std::uint64_t points = 0, triangles = 0;
};

struct Taken {
  double wall = 0.0, cpu = 0.0;  ///< seconds; CPU time of all threads
};

/// Draws a scene as the full mesh and as umbrellas.
class Drawing {
 public:
  explicit Drawing(const std::string& directory)
      : context_(must(base::HeadlessContext::create())),
        scene_(must(base::readScene(directory))),
        patches_(must(lod::patch::PatchFile::open(directory + "/patch.lgp"))),
        mesh_(must(server::SceneRenderer::create(scene_, patches_))),
        umbrellas_(must(server::UmbrellaScene::create(directory, scene_))) {}

  Drawn draw(float tolerance, const base::Camera& camera, int samples) {
    if (tolerance == kFullMesh) {
      auto picture = must(mesh_->render(camera, {.tolerance_px = 0.0F, .supersampling = samples}));
      return {std::move(picture.rgba), 0, picture.triangles};
    }
    server::UmbrellaOptions options;
    options.supersampling = samples;
    options.tolerance = tolerance;
    auto picture = must(umbrellas_->render(camera, options));
    return {std::move(picture.rgba), picture.points, picture.triangles};
  }

  /// Draws twice and times the second one, which finds everything decoded and on the GPU.
  Taken time(float tolerance, const base::Camera& camera) {
    draw(tolerance, camera, 1);
    const double wall = seconds(), cpu = seconds(CLOCK_PROCESS_CPUTIME_ID);
    draw(tolerance, camera, 1);
    return {seconds() - wall, seconds(CLOCK_PROCESS_CPUTIME_ID) - cpu};
  }

  std::string renderer() const { return context_->renderer(); }
  const base::Sphere& bounds() const { return umbrellas_->bounds(); }
  std::uint64_t meshTriangles() const { return patches_.hierarchy().source_triangles; }

 private:
  const std::unique_ptr<base::HeadlessContext> context_;
  const base::Scene scene_;
  const lod::patch::PatchFile patches_;
  const std::unique_ptr<server::SceneRenderer> mesh_;
  const std::unique_ptr<server::UmbrellaScene> umbrellas_;
};

struct Size {
  int width = 0, height = 0;
};

/// The views go around the model once and meanwhile up and down three times.
base::Camera cameraAt(const Drawing& drawing, int view, int views, double radii, const Size& size) {
  const double turn = 2.0 * std::numbers::pi * view / views;
  base::ViewCamera at;
  const double pitch = 0.3 + 0.4 * std::sin(3.0 * turn);
  const glm::dvec3 away(std::cos(turn) * std::cos(pitch), std::sin(turn) * std::cos(pitch), std::sin(pitch));
  at.position = glm::dvec3(drawing.bounds().center) + radii * static_cast<double>(drawing.bounds().radius) * away;
  at.direction = -away;
  at.up = {0, 0, 1};
  at.width = size.width;
  at.height = size.height;
  return base::cameraForScene(at, glm::dvec3(0.0), drawing.bounds());
}

std::uint64_t coveredPixels(const base::Image& rgba) {
  std::uint64_t covered = 0;
  for (std::size_t i = 3; i < rgba.pixels.size(); i += 4) covered += rgba.pixels[i] >= 128 ? 1 : 0;
  return covered;
}

// ---- Table 2 ----

/// Figures of a method, one of each view.
struct Row {
  std::vector<double> wall, cpu, points, triangles, psnr_db, missing;
};

void measureView(Drawing& drawing, const base::Camera& camera, std::array<Row, kTolerances.size()>& rows) {
  const base::Image truth = drawing.draw(kFullMesh, camera, kAccurateSamples).rgba;
  std::array<std::vector<double>, kTolerances.size()> wall, cpu;
  for (int run = 0; run < kRuns; ++run)
    for (std::size_t k = 0; k < rows.size(); ++k) {
      const Taken taken = drawing.time(kTolerances[k], camera);
      wall[k].push_back(taken.wall);
      cpu[k].push_back(taken.cpu);
    }
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const Drawn drawn = drawing.draw(kTolerances[k], camera, kAccurateSamples);
    const compare::Accuracy accuracy = must(compare::measureAccuracy(truth, drawn.rgba));
    rows[k].wall.push_back(median(wall[k]));
    rows[k].cpu.push_back(median(cpu[k]));
    rows[k].points.push_back(static_cast<double>(drawn.points));
    rows[k].triangles.push_back(static_cast<double>(drawn.triangles));
    rows[k].psnr_db.push_back(accuracy.psnr_db);
    rows[k].missing.push_back(accuracy.missing_share);
  }
}

void printTable(Drawing& drawing, int views, const Size& size) {
  std::printf("medians of %d views\n", views);
  std::printf("radii  drawn           frames/s  CPU ms  triangles    points      dB  uncovered\n");
  for (const double radii : {1.2, 2.5, 10.0}) {
    std::array<Row, kTolerances.size()> rows;
    for (int view = 0; view < views; ++view) measureView(drawing, cameraAt(drawing, view, views, radii, size), rows);
    for (std::size_t k = 0; k < rows.size(); ++k) {
      const Row& row = rows[k];
      const std::string name =
          kTolerances[k] == kFullMesh ? "full mesh" : "tolerance " + std::to_string(static_cast<int>(kTolerances[k]));
      std::printf("%5.1f  %-14s %9.2f %7.0f %10.0f %9.0f %7.2f  %.4f %%\n", radii, name.c_str(), 1.0 / median(row.wall),
                  1e3 * median(row.cpu), median(row.triangles), median(row.points), median(row.psnr_db),
                  100.0 * median(row.missing));
    }
    std::fflush(stdout);
  }
}

// ---- Figure 6 ----

void printDistances(Drawing& drawing, const Size& size) {
  constexpr int kDistances = 13, kViewsEach = 4;
  std::printf("radii,points,triangles,pixels,pixels_per_primitive,frames_per_second,mesh_triangles,mesh_fps\n");
  for (int step = 0; step < kDistances; ++step) {
    const double radii = std::exp2(0.5 * step);
    double points = 0.0, triangles = 0.0, pixels = 0.0, mesh_triangles = 0.0;
    std::vector<double> wall, mesh_wall;
    for (int view = 0; view < kViewsEach; ++view) {
      const base::Camera camera = cameraAt(drawing, view, kViewsEach, radii, size);
      mesh_wall.push_back(drawing.time(kFullMesh, camera).wall);
      wall.push_back(drawing.time(1.0F, camera).wall);
      const Drawn drawn = drawing.draw(1.0F, camera, 1);
      points += static_cast<double>(drawn.points) / kViewsEach;
      triangles += static_cast<double>(drawn.triangles) / kViewsEach;
      pixels += static_cast<double>(coveredPixels(drawn.rgba)) / kViewsEach;
      mesh_triangles += static_cast<double>(drawing.draw(kFullMesh, camera, 1).triangles) / kViewsEach;
    }
    std::printf("%.2f,%.0f,%.0f,%.0f,%.3f,%.1f,%.0f,%.1f\n", radii, points, triangles, pixels,
                pixels / std::max(points + triangles, 1.0), 1.0 / median(wall), mesh_triangles,
                1.0 / median(mesh_wall));
    std::fflush(stdout);
  }
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(argc, argv, "MESH [--width W] [--height H] [--views N] [--only table|distance]");
  const Size size{static_cast<int>(arguments.number("--width", 1280U, 16U, 8192U)),
                  static_cast<int>(arguments.number("--height", 720U, 16U, 8192U))};
  const auto views = static_cast<int>(arguments.number("--views", 12U, 1U, 1000U));
  const std::string only = arguments.text("--only", "");
  arguments.finish();
  if (arguments.input().empty() || (!only.empty() && only != "table" && only != "distance")) arguments.wrong();
  const bench::WorkDirectory directory;
  bench::runBuild(LUMIGRID_PROGRAM, "patch,pmr", arguments.input(), directory / "scene", 2, {});
  Drawing drawing(directory / "scene");
  std::printf("%s, %llu triangles, %d x %d pixels; %s, %s\n", arguments.input().c_str(),
              static_cast<unsigned long long>(drawing.meshTriangles()), size.width, size.height,
              drawing.renderer().c_str(), compare::machineName().c_str());
  std::fflush(stdout);
  if (only.empty() || only == "table") printTable(drawing, views, size);
  if (only.empty() || only == "distance") printDistances(drawing, size);
  return 0;
}
