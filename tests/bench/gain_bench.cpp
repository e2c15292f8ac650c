// Shows how well the plan's expected errors (plan/gain_order.h) tell those of pictures: random views, from coarse and
// fine cuts, without images, with few and with many, against the full model with 4 x 4 samples a pixel.
//
//   gain_bench SCENE [--views N] [--seed S] [--truth DIR] [--measured FILE] [--chart FILE.svg]
//
// It prints a row for each picture: view, tolerance in pixels, points, depth of the finest tiles, measured and expected
// error as root mean squares over the picture in levels, 0..255; at last the correlation of their logarithms and the
// median of their ratios. --measured keeps what pictures showed for another run, which then only plans. --chart draws
// the rows as PSNR over the picture.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <map>
#include <string>
#include <tuple>
#include <vector>

#include "base/egl/headless.h"
#include "base/format_text.h"
#include "base/picture_error.h"
#include "compare/chart.h"
#include "plan/view_plan.h"
#include "repository/store.h"
#include "server/bake/face_encoder.h"
#include "server/trial/direct_viewer.h"
#include "server/views/random_views.h"
#include "tests/bench/bench.h"
#include "tests/bench/truths.h"

namespace {

using bench::must;

constexpr int kWidth = 640, kHeight = 360;
constexpr float kTolerances[] = {512.0F, 128.0F, 32.0F, 8.0F, 2.0F, 1.0F};
/// Points, and the depth of their finest tiles.
constexpr std::pair<std::uint16_t, std::uint32_t> kImages[] = {{0, 5}, {1, 5}, {8, 1}, {8, 2}, {8, 5}};

/// View, tolerance, points, depth.
using Setting = std::tuple<std::size_t, float, std::uint16_t, std::uint32_t>;

/// A repository of which only tiles of less than some depth are seen.
class CoarseTiles : public repository::Store {
 public:
  CoarseTiles(const repository::Store& all, std::uint32_t depth)
      : all_(all), end_(repository::firstTileOf(std::min(depth, repository::kMaxTileDepth) + 1)) {}
  base::Result<std::optional<base::Bytes>> get(const repository::FaceKey& key) const override {
    if (key.tile >= end_) return std::optional<base::Bytes>();
    return all_.get(key);
  }
  base::Result<std::optional<std::uint64_t>> valueBytes(const repository::FaceKey& key) const override {
    if (key.tile >= end_) return std::optional<std::uint64_t>();
    return all_.valueBytes(key);
  }
  base::Result<void> forEach(
      const std::function<bool(const repository::FaceKey&, base::ByteView)>& visit) const override {
    return all_.forEach(
        [&](const repository::FaceKey& key, base::ByteView value) { return key.tile >= end_ || visit(key, value); });
  }
  base::Result<std::uint64_t> size() const override { return all_.size(); }
  base::Result<std::optional<std::string>> readMeta() const override { return all_.readMeta(); }

 protected:
  base::Error readOnlyError() const override { return {base::ErrorCode::kUnsupported, "only read"}; }

 private:
  const repository::Store& all_;
  const std::uint32_t end_;
};

std::map<Setting, double> readMeasured(const std::string& file) {
  std::map<Setting, double> measured;
  std::ifstream in(file);
  std::size_t view = 0;
  float tolerance = 0.0F;
  std::uint16_t points = 0;
  std::uint32_t depth = 0;
  double error = 0.0;
  while (in >> view >> tolerance >> points >> depth >> error) measured[{view, tolerance, points, depth}] = error;
  return measured;
}

/// Mean squared error over the picture, 0..1.
double measure(const server::SceneData& data, const protocol::View& view, const base::Image& truth) {
  client::ViewerOptions options = server::settledOptions(client::Method::kLumigraph);
  options.session.patch_tolerance_px = view.patch_tolerance_px;
  options.session.max_points = view.max_points;
  options.lumigraph.use_images = view.max_points != 0;
  server::DirectViewer viewer(data, options);
  const base::Image shown = must(viewer.show(view.camera));
  return base::foregroundError(truth, shown).squared / (3.0 * 255.0 * 255.0 * kWidth * kHeight);
}

class Fit {
 public:
  void add(double measured, double expected) {
    const double x = std::log(measured), y = std::log(expected);
    ++n_, x_ += x, y_ += y, xx_ += x * x, yy_ += y * y, xy_ += x * y;
    ratios_.push_back(std::sqrt(expected / measured));
  }
  void print(const std::string& name) const {
    const double correlation = (n_ * xy_ - x_ * y_) / std::sqrt((n_ * xx_ - x_ * x_) * (n_ * yy_ - y_ * y_));
    std::printf("%s: %.0f pictures, correlation %.3f, median of expected over measured %.2f\n", name.c_str(), n_,
                correlation, bench::median(ratios_));
  }

 private:
  double n_ = 0.0, x_ = 0.0, y_ = 0.0, xx_ = 0.0, yy_ = 0.0, xy_ = 0.0;
  std::vector<double> ratios_;
};

/// Expected over measured accuracy, a series for each kind of images, and the line on which both are the same.
class FitChart {
 public:
  explicit FitChart(const std::string& scene) {
    chart_.title = scene + ": expected and measured accuracy";
    chart_.x_label = "measured PSNR, dB", chart_.y_label = "expected PSNR, dB";
    for (const auto& [points, depth] : kImages)
      chart_.series.push_back({points == 0  ? "no images"
                               : depth >= 5 ? base::formatText("%u point%s", unsigned{points}, points == 1 ? "" : "s")
                                            : base::formatText("%u points, depth %u", unsigned{points}, depth),
                               {},
                               false});
  }
  void add(std::uint16_t points, std::uint32_t depth, double measured, double expected) {
    const double x = -10.0 * std::log10(measured), y = -10.0 * std::log10(expected);
    for (std::size_t i = 0; i < std::size(kImages); ++i)
      if (kImages[i] == std::pair(points, depth)) chart_.series[i].points.emplace_back(x, y);
    low_ = std::min(low_, x), high_ = std::max(high_, x);
  }
  void write(const std::string& path) {
    chart_.series.push_back({"equal", {{low_, low_}, {high_, high_}}, true});
    if (!(std::ofstream(path) << compare::formatChart(chart_))) bench::stop(path + ": cannot be written");
  }

 private:
  compare::Chart chart_;
  double low_ = 1e9, high_ = -1e9;
};

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(argc, argv,
                             "SCENE [--views 1..1000] [--seed S] [--truth DIR] [--measured FILE] [--chart FILE.svg]");
  server::RandomViews wanted;
  wanted.count = arguments.number("--views", std::size_t{6}, std::size_t{1}, std::size_t{1000});
  wanted.seed = arguments.number("--seed", 5U, 0U, 1U << 30U);
  wanted.width = kWidth, wanted.height = kHeight;
  const std::string directory = arguments.text("--truth", "");
  const std::string file = arguments.text("--measured", "");
  const std::string chart_path = arguments.text("--chart", "");
  arguments.finish();
  if (arguments.input().empty()) arguments.wrong();

  const auto [scene, views] = bench::openWithImages(arguments.input(), wanted);
  bench::Truths truths(*scene, directory);
  std::map<Setting, double> measured = readMeasured(file);
  std::ofstream kept;
  if (!file.empty()) kept.open(file, std::ios::app);

  Fit fit;
  FitChart chart(scene->name);
  std::printf("%4s %9s %6s %5s %9s %9s\n", "view", "tolerance", "points", "depth", "measured", "expected");
  for (std::size_t i = 0; i < views.size(); ++i) {
    for (const float tolerance : kTolerances)
      for (const auto& [points, depth] : kImages) {
        protocol::View view;
        view.camera = views[i];
        view.patch_tolerance_px = tolerance;
        view.measure = base::ErrorMeasure::kShape;
        view.max_points = points;
        const CoarseTiles coarse(*scene->data.images, depth);
        server::SceneData data = scene->data;
        data.images = &coarse;
        const Setting setting{i, tolerance, points, depth};
        if (measured.count(setting) == 0) {
          const base::Image truth = truths.of(views[i], wanted.seed, i);
          measured[setting] = server::showsModel(truth) ? measure(data, view, truth) : 0.0;
          if (kept.is_open())
            kept << i << " " << tolerance << " " << points << " " << depth << " " << measured[setting] << std::endl;
        }
        if (measured[setting] <= 0.0) continue;
        protocol::Welcome welcome = data.welcome;
        const repository::Grid& grid = scene->data.welcome.grid;
        if (grid.isTiled()) welcome.grid = repository::withTiles(grid, std::min(depth, grid.tile_depth));
        plan::Scene planned = data.toPlan();
        planned.welcome = &welcome;
        planned.stored_bytes = [&](const repository::FaceKey& key) {
          return std::optional<std::uint64_t>(must(coarse.valueBytes(key)).value_or(0));
        };
        const double expected = static_cast<double>(plan::planView(planned, view).error_after);
        fit.add(measured[setting], expected);
        chart.add(points, depth, measured[setting], expected);
        std::printf("%4zu %9.0f %6u %5u %9.2f %9.2f\n", i, static_cast<double>(tolerance), unsigned{points}, depth,
                    255.0 * std::sqrt(measured[setting]), 255.0 * std::sqrt(expected));
        std::fflush(stdout);
      }
  }
  fit.print(scene->name);
  if (!chart_path.empty()) chart.write(chart_path);
  return 0;
}
