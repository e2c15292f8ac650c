// hlod_rate_bench SCENE --shape SCENE2 [--width W] [--height H] [--views N] [--chart FILE.svg]
// Frame rates on one path around and towards a scene (Guthe et al. 2004, table 3): the full mesh, nodes with
// appearance, nodes of shape alone, splats and patches, drawn in turn by the server's renderers with one sample a pixel
// and read back, beside how far their pictures are from the full mesh's, both with 4 x 4 samples. SCENE has patches,
// splats and nodes; SCENE2 nodes of the same mesh built with --appearance none. Each is drawn at errors of 0.5, 1, 2
// and 4 pixels.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <numbers>

#include "base/file.h"
#include "base/format_text.h"
#include "compare/accuracy.h"
#include "compare/chart.h"
#include "compare/run.h"
#include "server/render/scene_renderer.h"
#include "server/render/splat_scene.h"
#include "tests/bench/hlod_scenes.h"

namespace {

using bench::median;
using bench::must;
using bench::seconds;

constexpr int kRuns = 3, kAccurateSamples = 4;
constexpr std::array kErrors{0.5F, 1.0F, 2.0F, 4.0F};  // pixels

struct Drawn {
  base::Image rgba;
  std::uint64_t primitives = 0;
};

/// A way to draw, with its figures of each view.
struct Way {
  std::string method;
  float error = 0.0F;  ///< pixels; 0: the full mesh
  std::vector<double> wall, cpu, primitives, psnr_db;
};

class Drawing {
 public:
  Drawing(const std::string& directory, const std::string& shape_directory)
      : context_(must(base::HeadlessContext::create())),
        scene_(must(base::readScene(directory))),
        patches_(must(lod::patch::PatchFile::open(directory + "/patch.lgp"))),
        splats_(must(server::openSplats(directory, scene_))),
        mesh_(must(server::SceneRenderer::create(scene_, patches_))),
        splat_scene_(must(server::SplatScene::create(scene_, splats_))),
        nodes_(must(server::HlodScene::create(directory, scene_))),
        shape_(must(server::HlodScene::create(shape_directory, bench::litAs(scene_, shape_directory)))) {}

  Drawn draw(const Way& way, const base::Camera& camera, int samples) {
    if (way.method == "hlod") return drawNodes(*nodes_, way.error, camera, samples);
    if (way.method == "shape alone") return drawNodes(*shape_, way.error, camera, samples);
    if (way.method == "qsplat") return drawSplats(way.error, camera, samples);
    auto picture = must(mesh_->render(camera, {.tolerance_px = way.error, .supersampling = samples}));
    return {std::move(picture.rgba), picture.triangles};
  }

  const base::Sphere& bounds() const { return nodes_->bounds(); }
  std::string renderer() const { return context_->renderer(); }

 private:
  static Drawn drawNodes(server::HlodScene& nodes, float error, const base::Camera& camera, int samples) {
    server::HlodOptions options;
    options.supersampling = samples;
    options.tolerance = error;
    auto picture = must(nodes.render(camera, options));
    return {std::move(picture.rgba), picture.count.triangles + picture.count.points};
  }
  /// A splat shows its middle at most its radius away, so the error is half of the diameter that is asked for.
  Drawn drawSplats(float error, const base::Camera& camera, int samples) {
    server::SplatOptions options;
    options.supersampling = samples;
    options.cutoff_px = 2.0F * error;
    auto picture = must(splat_scene_->render(camera, options));
    return {std::move(picture.rgba), picture.splats};
  }

  const std::unique_ptr<base::HeadlessContext> context_;
  const base::Scene scene_;
  const lod::patch::PatchFile patches_;
  const lod::qsplat::SplatFile splats_;
  const std::unique_ptr<server::SceneRenderer> mesh_;
  const std::unique_ptr<server::SplatScene> splat_scene_;
  const std::unique_ptr<server::HlodScene> nodes_, shape_;
};

/// The path goes around the model once, up and down, and from 4 radii to 1.1.
base::Camera cameraAt(const base::Sphere& bounds, int view, int views, const bench::PictureSize& size) {
  const double part = (view + 0.5) / views, turn = 2.0 * std::numbers::pi * part;
  return bench::orbitCamera(bounds, turn, 0.6 + 0.3 * std::sin(3.0 * turn), 4.0 * std::pow(1.1 / 4.0, part), size);
}

std::vector<Way> allWays() {
  std::vector<Way> ways{{"full mesh", 0.0F, {}, {}, {}, {}}};
  for (const char* method : {"hlod", "shape alone", "qsplat", "patches"})
    for (const float error : kErrors) ways.push_back({method, error, {}, {}, {}, {}});
  return ways;
}

/// The full mesh is the first way. Each is drawn once before any is timed, so that nothing is decoded then.
void measureView(Drawing& drawing, const base::Camera& camera, std::vector<Way>& ways) {
  const base::Image truth = drawing.draw(ways[0], camera, kAccurateSamples).rgba;
  for (Way& way : ways) {
    const Drawn drawn = drawing.draw(way, camera, kAccurateSamples);
    way.psnr_db.push_back(must(compare::measureAccuracy(truth, drawn.rgba)).psnr_db);
    way.primitives.push_back(static_cast<double>(drawing.draw(way, camera, 1).primitives));
  }
  std::vector<std::vector<double>> wall(ways.size()), cpu(ways.size());
  for (int run = 0; run < kRuns; ++run)
    for (std::size_t k = 0; k < ways.size(); ++k) {
      const double wall_begin = seconds(), cpu_begin = seconds(CLOCK_PROCESS_CPUTIME_ID);
      drawing.draw(ways[k], camera, 1);
      wall[k].push_back(seconds() - wall_begin);
      cpu[k].push_back(seconds(CLOCK_PROCESS_CPUTIME_ID) - cpu_begin);
    }
  for (std::size_t k = 0; k < ways.size(); ++k) {
    ways[k].wall.push_back(median(wall[k]));
    ways[k].cpu.push_back(median(cpu[k]));
  }
}

double mean(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

double framesPerSecond(const Way& way) {
  return 1.0 / mean(way.wall);
}

void printTable(const std::vector<Way>& ways) {
  double base = 0.0;
  for (const Way& way : ways)
    if (way.method == "hlod" && way.error == kErrors[0]) base = framesPerSecond(way);
  std::printf("drawn        error, px  frames/s  times hlod's at 0.5  least frames/s  CPU ms  primitives      dB\n");
  for (const Way& way : ways)
    std::printf("%-12s %9.1f %9.2f %21.2f %15.2f %7.0f %11.0f %7.2f\n", way.method.c_str(),
                static_cast<double>(way.error), framesPerSecond(way), framesPerSecond(way) / base,
                1.0 / *std::max_element(way.wall.begin(), way.wall.end()), 1e3 * mean(way.cpu), mean(way.primitives),
                mean(way.psnr_db));
}

void writeChart(const std::vector<Way>& ways, const std::string& title, const std::string& path) {
  compare::Chart chart{title, "frames a second", "PSNR, dB", true, {}};
  for (const Way& way : ways) {
    if (way.error == 0.0F) continue;
    if (chart.series.empty() || chart.series.back().name != way.method) chart.series.push_back({way.method, {}, true});
    chart.series.back().points.emplace_back(framesPerSecond(way), mean(way.psnr_db));
  }
  must(base::writeFileAtomically(path, base::viewOfText(compare::formatChart(chart))));
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(argc, argv,
                             "SCENE --shape SCENE2 [--width W] [--height H] [--views N] [--chart FILE.svg]");
  const bench::PictureSize size{static_cast<int>(arguments.number("--width", 1280U, 16U, 8192U)),
                                static_cast<int>(arguments.number("--height", 720U, 16U, 8192U))};
  const auto views = static_cast<int>(arguments.number("--views", 8U, 1U, 1000U));
  const std::string shape = arguments.text("--shape", ""), chart = arguments.text("--chart", "");
  arguments.finish();
  if (arguments.input().empty() || shape.empty()) arguments.wrong();
  Drawing drawing(arguments.input(), shape);
  std::printf("%s, %d views of %d x %d pixels; %s, %s\n", arguments.input().c_str(), views, size.width, size.height,
              drawing.renderer().c_str(), compare::machineName().c_str());
  std::vector<Way> ways = allWays();
  for (int view = 0; view < views; ++view) measureView(drawing, cameraAt(drawing.bounds(), view, views, size), ways);
  printTable(ways);
  const std::string name = std::filesystem::path(arguments.input()).stem().string();
  if (!chart.empty())
    writeChart(ways, base::formatText("%s, %d x %d, on a path", name.c_str(), size.width, size.height), chart);
  return 0;
}
