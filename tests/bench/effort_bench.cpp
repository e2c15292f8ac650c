// Shows what less effort for a moving view's pictures costs and saves: settled pictures of random views, drawn as at
// rest (the mean of 8 pictures) and with each effort that the governor may choose, against the full model with 4 x 4
// samples a pixel.
//
//   effort_bench SCENE [--views N] [--seed S] [--width W] [--height H] [--truth DIR]
//
// For each effort it prints means of PSNR and SSIM, and medians of the time to draw and of its ratio to that of the
// proxy alone with one sample a pixel. The last rows blend every fragment of the proxy by itself, in place of every
// pixel once. --truth keeps the true pictures for another run.
#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "base/format_text.h"
#include "client/viewer/draw_governor.h"
#include "compare/accuracy.h"
#include "server/bake/face_encoder.h"
#include "server/trial/direct_viewer.h"
#include "tests/bench/bench.h"
#include "tests/bench/truths.h"

namespace {

using bench::must;

constexpr int kRepeats = 3;

/// A viewer of one effort, and what its pictures came to.
struct Row {
  std::string name;
  std::unique_ptr<server::DirectViewer> viewer;
  double psnr = 0.0, ssim = 0.0;     // sums
  std::vector<double> milliseconds;  // of each view
};

Row makeRow(const server::SceneData& data, const client::DrawEffort& effort, bool images, bool once = true) {
  client::ViewerOptions options = server::settledOptions(client::Method::kLumigraph);
  options.effort = effort;
  options.lumigraph.use_images = images;
  options.lumigraph.blend_once = once;
  return {base::formatText("%d x %d samples, %4.2f of the width, %2d points a patch%s", effort.pictures, effort.samples,
                           static_cast<double>(effort.scale), images ? effort.points : 0, once ? "" : ", each"),
          std::make_unique<server::DirectViewer>(data, options),
          0.0,
          0.0,
          {}};
}

void measure(Row& row, const base::ViewCamera& view, const base::Image& truth) {
  const base::Image first = must(row.viewer->show(view));
  std::vector<double> times;
  for (int i = 0; i < kRepeats; ++i) {
    const double start = bench::seconds();
    must(row.viewer->show(view));
    times.push_back(1e3 * (bench::seconds() - start));
  }
  row.milliseconds.push_back(bench::median(times));
  const compare::Accuracy accuracy = must(compare::measureAccuracy(truth, first));
  row.psnr += accuracy.psnr_db, row.ssim += accuracy.ssim;
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(argc, argv, bench::kViewUsage);
  const bench::ViewArguments wanted = bench::viewArguments(arguments, 6);
  arguments.finish();
  const auto [scene, views] = bench::openWithImages(wanted.scene, wanted.views);
  bench::Truths truths(*scene, wanted.truths);

  std::vector<Row> rows;
  rows.push_back(makeRow(scene->data, {}, false));
  for (const int pictures : {8, 4}) rows.push_back(makeRow(scene->data, {.pictures = pictures}, true));
  for (const client::DrawEffort& effort : client::DrawGovernor::efforts(4))
    rows.push_back(makeRow(scene->data, effort, true));
  for (const int samples : {4, 1}) rows.push_back(makeRow(scene->data, {.samples = samples}, true, false));
  int shown = 0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const base::Image truth = truths.of(views[i], wanted.views.seed, i);
    if (!server::showsModel(truth)) continue;
    ++shown;
    for (Row& row : rows) measure(row, views[i], truth);
  }
  if (shown == 0) bench::stop("no view shows the model");

  std::printf("%s, %d views of %d x %d\n", scene->name.c_str(), shown, wanted.views.width, wanted.views.height);
  for (const Row& row : rows) {
    std::vector<double> ratios;
    for (std::size_t i = 0; i < row.milliseconds.size(); ++i)
      ratios.push_back(row.milliseconds[i] / rows.front().milliseconds[i]);
    std::printf("%-54s %6.2f dB  %.4f  %7.1f ms  %5.1f x\n", row.name.c_str(), row.psnr / shown, row.ssim / shown,
                bench::median(row.milliseconds), bench::median(ratios));
  }
  return 0;
}
