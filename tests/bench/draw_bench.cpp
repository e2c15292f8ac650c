// Shows what the pictures of a moving view cost the client, with images and by patches alone that are as accurate
// (figures 10 and 11 of Okamoto et al. 2011): random views that turn by a little from picture to picture, all data
// here.
//
//   draw_bench SCENE [--views N] [--seed S] [--width W] [--height H] [--truth DIR] [--turns N] [--samples 1..4]
//              [--patches 0] [--pictures DIR]
//
// Each row has PSNR and SSIM of one picture as a moving view shows it, means over the views, against the full model
// with 4 x 4 samples a pixel; median and 95th percentile of the time of a picture, with the choice of its patches and
// the wait for the GPU but nothing read back; and triangles. Each view is turned N times (40). The last line compares
// images with patches that would be as accurate as they are, by the rows to either side; --patches 0 leaves patches
// out. --pictures keeps the pictures with images.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/egl/headless.h"
#include "base/format_text.h"
#include "base/gl/gl.h"
#include "base/png/png.h"
#include "compare/accuracy.h"
#include "server/bake/face_encoder.h"
#include "server/trial/direct_viewer.h"
#include "tests/bench/bench.h"
#include "tests/bench/truths.h"

namespace {

using bench::must;

constexpr double kTurn = 1.0 / 600.0;  ///< radians a picture: ten degrees a second at a hundred pictures

// The tolerance decides, no budget.
constexpr std::uint32_t kNoLimit = 50'000'000;
constexpr std::uint64_t kAmpleMemory = 16'000'000'000;

struct Row {
  std::string name;
  std::unique_ptr<server::DirectViewer> viewer;
  double psnr = 0.0, ssim = 0.0, triangles = 0.0;  // sums over views
  std::vector<double> milliseconds;                // of all pictures
};

double percentile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1, static_cast<std::size_t>(share * static_cast<double>(values.size())))];
}

Row rowOf(const server::SceneData& data, const std::string& name, client::Method method, float tolerance, int samples) {
  client::ViewerOptions options = server::settledOptions(method);
  options.effort = client::DrawEffort{.samples = samples};
  if (tolerance > 0.0F) {
    options.session.setPatchTolerance(tolerance);
    options.session.max_triangles = kNoLimit;
    options.memory_budget_bytes = kAmpleMemory;
  }
  return {name, std::make_unique<server::DirectViewer>(data, options), 0.0, 0.0, 0.0, {}};
}

/// Turns the view right and left again by the same angle.
base::ViewCamera turned(base::ViewCamera view, int turn, int turns) {
  const int steps = turn < turns / 2 ? turn + 1 : turns - turn;
  const glm::dvec3 right = glm::normalize(glm::cross(view.direction, view.up));
  const double angle = kTurn * steps;
  view.direction = glm::normalize(std::cos(angle) * view.direction + std::sin(angle) * right);
  return view;
}

/// Returns the picture that accuracy is measured of.
base::Image measure(Row& row, const base::ViewCamera& view, const base::Image& truth, int turns) {
  base::Image picture = must(row.viewer->show(view));
  const compare::Accuracy accuracy = must(compare::measureAccuracy(truth, picture));
  row.psnr += accuracy.psnr_db, row.ssim += accuracy.ssim;
  row.triangles += static_cast<double>(row.viewer->viewer().stats().lumigraph.triangles);
  const auto target = must(base::gl::RenderTarget::create(view.width, view.height));
  target.bind();
  // The first time images are decoded, and depth maps drawn.
  for (int i = -turns; i < turns; ++i) {
    const double start = bench::seconds();
    must(row.viewer->redraw(turned(view, (i + turns) % turns, turns)));
    glFinish();
    if (i >= 0) row.milliseconds.push_back(1e3 * (bench::seconds() - start));
  }
  return picture;
}

/// Compares the first row with patches that would be as accurate: between two rows the logarithm of the time goes with
/// the PSNR.
void printRatio(const std::vector<Row>& rows) {
  const Row& images = rows.front();
  const double time = bench::median(images.milliseconds);
  for (std::size_t i = 2; i < rows.size(); ++i) {
    const Row &coarse = rows[i - 1], &fine = rows[i];
    if (images.psnr < coarse.psnr || images.psnr > fine.psnr) continue;
    const double part = (images.psnr - coarse.psnr) / std::max(fine.psnr - coarse.psnr, 1e-9);
    const double from = std::log(bench::median(coarse.milliseconds)), to = std::log(bench::median(fine.milliseconds));
    const double patches = std::exp(from + part * (to - from));
    std::printf("images take %.2f of the %.1f ms of patches that are as accurate\n", time / patches, patches);
    return;
  }
  std::printf("no patches here are as accurate as images\n");
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(
      argc, argv,
      std::string(bench::kViewUsage) + " [--turns 2..1000] [--samples 1..4] [--patches 0..1] [--pictures DIR]");
  const bench::ViewArguments wanted = bench::viewArguments(arguments, 6);
  const int turns = static_cast<int>(arguments.number("--turns", 40U, 2U, 1000U));
  const int samples = static_cast<int>(arguments.number("--samples", 4U, 1U, 4U));
  const bool patches = arguments.number("--patches", 1U, 0U, 1U) == 1;
  const std::string directory = arguments.text("--pictures", "");
  arguments.finish();
  if (!directory.empty()) std::filesystem::create_directories(directory);
  const auto [scene, views] = bench::openWithImages(wanted.scene, wanted.views);
  bench::Truths truths(*scene, wanted.truths);

  std::vector<Row> rows;
  rows.push_back(rowOf(scene->data, "images", client::Method::kLumigraph, 0.0F, samples));
  constexpr std::array<float, 6> kTolerances{4.0F, 2.0F, 1.0F, 0.5F, 0.25F, 0.125F};
  for (const float tolerance : std::span(kTolerances).first(patches ? kTolerances.size() : 0))
    rows.push_back(rowOf(scene->data, base::formatText("patches, %g px", static_cast<double>(tolerance)),
                         client::Method::kPatches, tolerance, samples));
  int shown = 0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const base::Image truth = truths.of(views[i], wanted.views.seed, i);
    if (!server::showsModel(truth)) continue;
    ++shown;
    for (Row& row : rows) {
      const base::Image picture = measure(row, views[i], truth, turns);
      if (!directory.empty() && &row == &rows.front())
        must(base::writePng(picture, base::formatText("%s/%03zu.png", directory.c_str(), i)));
    }
  }
  if (shown == 0) bench::stop("no view shows the model");

  std::printf("%s, %d views of %d x %d, %d samples a pixel, %s\n", scene->name.c_str(), shown, wanted.views.width,
              wanted.views.height, samples, reinterpret_cast<const char*>(glGetString(GL_RENDERER)));
  for (const Row& row : rows)
    std::printf("%-18s %6.2f dB  %.4f  median %7.2f ms  95th %7.2f ms  %9.0f triangles\n", row.name.c_str(),
                row.psnr / shown, row.ssim / shown, bench::median(row.milliseconds), percentile(row.milliseconds, 0.95),
                row.triangles / shown);
  if (patches) printRatio(rows);
  return 0;
}
