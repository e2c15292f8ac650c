// Shows what the parts of a picture cost and bring: settled pictures of random views, against the full model with 4 x 4
// samples a pixel.
//
//   effort_bench SCENE [--views N] [--seed S] [--width W] [--height H] [--truth DIR] [--parts 1]
//
// The rows are the picture as at rest (the mean of 8 pictures) and with each effort that the governor may choose; the
// last ones blend every fragment of the proxy by itself, in place of every pixel once. With --parts 1 each row leaves
// out one part of what a picture at rest is made of, the refinement of its patches among them.
//
// For each row it prints means of PSNR, SSIM and the distance of silhouettes, the bytes that came, and medians of the
// time to draw and of its ratio to that of the proxy alone with one sample a pixel. --truth keeps the true pictures for
// another run.
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

/// A viewer, and what its pictures came to.
struct Row {
  std::string name;
  std::unique_ptr<server::DirectViewer> viewer;
  double psnr = 0.0, ssim = 0.0, silhouette = 0.0;  // sums
  std::vector<double> milliseconds;                 // of each view
};

class Rows {
 public:
  explicit Rows(const server::SceneData& data) : data_(data) {}

  /// Adds a row of the options of a picture at rest, changed by `change`.
  template <class Change>
  void add(const std::string& name, const Change& change) {
    client::ViewerOptions options = server::settledOptions(client::Method::kLumigraph);
    change(options);
    rows.push_back({name, std::make_unique<server::DirectViewer>(data_, options), 0.0, 0.0, 0.0, {}});
  }
  void addEffort(const client::DrawEffort& effort, bool images, bool once = true) {
    const std::string name =
        base::formatText("%d x %d samples, %4.2f of the width, %2d points a patch%s", effort.pictures, effort.samples,
                         static_cast<double>(effort.scale), images ? effort.points : 0, once ? "" : ", each");
    add(name, [&](client::ViewerOptions& options) {
      options.effort = effort;
      options.lumigraph.use_images = images;
      options.lumigraph.blend_once = once;
    });
  }
  void addEfforts() {
    for (const int pictures : {8, 4}) addEffort({.pictures = pictures}, true);
    for (const client::DrawEffort& effort : client::DrawGovernor::efforts(4)) addEffort(effort, true);
    for (const int samples : {4, 1}) addEffort({.samples = samples}, true, false);
  }
  void addParts();

  std::vector<Row> rows;

 private:
  const server::SceneData& data_;
};

void Rows::addParts() {
  using Options = client::ViewerOptions;
  add("all parts", [](Options& o) { o.session.refine = true; });
  add("patches are not refined", [](Options&) {});
  // The others neither, since refined patches hide what images lack.
  add("without images", [](Options& o) { o.lumigraph.use_images = false; });
  add("four samples in place of the mean of 8 pictures",
      [](Options& o) { o.effort = client::DrawEffort{.samples = 4}; });
  add("one sample", [](Options& o) { o.effort = client::DrawEffort{}; });
  add("fragments are blended in place of pixels", [](Options& o) { o.lumigraph.blend_once = false; });
  add("nothing is carved", [](Options& o) { o.lumigraph.carve = false; });
  add("the proxy's own colours do not count", [](Options& o) { o.lumigraph.tuning.shade_weight = 0.0F; });
  add("blurred images count as much as sharp ones", [](Options& o) { o.lumigraph.tuning.resolution_power = 0.0F; });
  add("the nearest image counts as much as others", [](Options& o) { o.lumigraph.tuning.angle_power = 0.0F; });
  add("the proxy's error shifts no image", [](Options& o) { o.lumigraph.tuning.shift = 0.0F; });
  add("images behind whose eye the model may lie", [](Options& o) { o.lumigraph.tuning.near_errors = 0.0F; });
  add("no image is doubted", [](Options& o) { o.lumigraph.tuning.outlier = o.lumigraph.tuning.lit_outlier = 1e3F; });
  add("images may disagree", [](Options& o) { o.lumigraph.tuning.disagreement = 0.0F; });
  add("even colours err as much as others", [](Options& o) { o.lumigraph.tuning.even_error = 1.0F; });
  add("images are looked up at the pixel's own level", [](Options& o) { o.lumigraph.tuning.sharpen = -0.45F; });
}

void measure(Row& row, const base::ViewCamera& view, const base::Image& truth) {
  const base::Image first = must(row.viewer->show(view));
  std::vector<double> times;
  base::ViewCamera beside = view;
  for (int i = 0; i < kRepeats; ++i) {
    // A finished picture of the same view would only be shown again.
    beside.direction = glm::normalize(beside.direction + 1e-4 * beside.up);
    const double start = bench::seconds();
    must(row.viewer->show(beside));
    times.push_back(1e3 * (bench::seconds() - start));
  }
  row.milliseconds.push_back(bench::median(times));
  const compare::Accuracy accuracy = must(compare::measureAccuracy(truth, first));
  row.psnr += accuracy.psnr_db, row.ssim += accuracy.ssim, row.silhouette += accuracy.silhouette_px;
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(argc, argv, std::string(bench::kViewUsage) + " [--parts 0..1]");
  const bench::ViewArguments wanted = bench::viewArguments(arguments, 6);
  const bool parts = arguments.number("--parts", 0U, 0U, 1U) == 1;
  arguments.finish();
  const auto [scene, views] = bench::openWithImages(wanted.scene, wanted.views);
  bench::Truths truths(*scene, wanted.truths);

  Rows made(scene->data);
  std::vector<Row>& rows = made.rows;
  made.addEffort({}, false);
  if (parts)
    made.addParts();
  else
    made.addEfforts();
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
    std::printf("%-54s %6.2f dB  %.4f  %5.3f px  %6.2f MB  %7.1f ms  %5.1f x\n", row.name.c_str(), row.psnr / shown,
                row.ssim / shown, row.silhouette / shown, 1e-6 * static_cast<double>(row.viewer->bytesReceived()),
                bench::median(row.milliseconds), bench::median(ratios));
  }
  return 0;
}
