// Shows how much images add to their proxy: settled pictures of random views with images and without, on the same cut,
// against the full model with 4 x 4 samples a pixel.
//
//   blend_bench SCENE [--views N] [--seed S] [--width W] [--height H] [--truth DIR] [--pictures DIR] [--patches 1]
//               [--only VIEW]
//
// For each view it prints PSNR and SSIM of the proxy alone, by how much images change both, and the ratio of the times
// to draw. --truth keeps the true pictures for another run, --pictures all pictures; with --patches 1 patches alone at
// their own tolerance are shown beside. --only draws one of the views, by the number that is printed before it.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/egl/headless.h"
#include "base/format_text.h"
#include "base/png/png.h"
#include "compare/accuracy.h"
#include "server/bake/face_encoder.h"
#include "server/trial/direct_viewer.h"
#include "server/views/random_views.h"
#include "tests/bench/bench.h"
#include "tests/bench/truths.h"

namespace {

using bench::must;

struct Shown {
  base::Image picture;
  compare::Accuracy accuracy;
  double milliseconds = 0.0;
};

Shown show(server::DirectViewer& viewer, const base::ViewCamera& view, const base::Image& truth) {
  base::Image first = must(viewer.show(view));
  const double start = bench::seconds();
  must(viewer.show(view));
  const double milliseconds = 1e3 * (bench::seconds() - start);
  const compare::Accuracy accuracy = must(compare::measureAccuracy(truth, first));
  return {std::move(first), accuracy, milliseconds};
}

/// Sums of what images change.
class Gains {
 public:
  void add(const Shown& proxy, const Shown& images) {
    const double psnr = images.accuracy.psnr_db - proxy.accuracy.psnr_db;
    const double ssim = images.accuracy.ssim - proxy.accuracy.ssim;
    ++views_;
    proxy_psnr_ += proxy.accuracy.psnr_db;
    psnr_ += psnr, ssim_ += ssim;
    worst_psnr_ = std::min(worst_psnr_, psnr), worst_ssim_ = std::min(worst_ssim_, ssim);
    worse_ += psnr < -kMostPsnrLost || ssim < -kMostSsimLost ? 1 : 0;
    times_.push_back(images.milliseconds / proxy.milliseconds);
    std::printf("proxy %6.2f dB %.4f   images %+6.2f dB %+.4f   %4.1f x", proxy.accuracy.psnr_db, proxy.accuracy.ssim,
                psnr, ssim, times_.back());
  }
  int views() const { return views_; }
  void print(const std::string& name) const {
    std::printf("%s: %d views, proxy %.2f dB, images %+.2f dB %+.4f, worst %+.2f dB %+.4f, ", name.c_str(), views_,
                proxy_psnr_ / views_, psnr_ / views_, ssim_ / views_, worst_psnr_, worst_ssim_);
    std::printf("%d worse than allowed, median %.1f x the time", worse_, bench::median(times_));
  }

 private:
  static constexpr double kMostPsnrLost = 0.1, kMostSsimLost = 0.001;
  double proxy_psnr_ = 0.0, psnr_ = 0.0, ssim_ = 0.0, worst_psnr_ = 99.0, worst_ssim_ = 1.0;
  int worse_ = 0, views_ = 0;
  std::vector<double> times_;
};

void save(const std::string& directory, std::size_t view, const char* name, const base::Image& picture) {
  if (directory.empty()) return;
  std::filesystem::create_directories(directory);
  must(base::writePng(picture, base::formatText("%s/%03zu_%s.png", directory.c_str(), view, name)));
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(argc, argv,
                             std::string(bench::kViewUsage) + " [--pictures DIR] [--patches 0..1] [--only VIEW]");
  const bench::ViewArguments wanted = bench::viewArguments(arguments, 24);
  const std::string pictures = arguments.text("--pictures", "");
  const bool with_patches = arguments.number("--patches", 0U, 0U, 1U) == 1;
  const unsigned every = static_cast<unsigned>(-1);
  const unsigned only = arguments.number("--only", every, 0U, every);
  arguments.finish();
  const auto [scene, views] = bench::openWithImages(wanted.scene, wanted.views);
  bench::Truths truths(*scene, wanted.truths);

  client::ViewerOptions options = server::settledOptions(client::Method::kLumigraph);
  server::DirectViewer with_images(scene->data, options);
  options.lumigraph.use_images = false;
  server::DirectViewer proxy(scene->data, options);
  std::optional<server::DirectViewer> patches;
  if (with_patches) patches.emplace(scene->data, server::settledOptions(client::Method::kPatches));

  Gains gains;
  double patch_psnr = 0.0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (only != every && i != only) continue;
    const base::Image truth = truths.of(views[i], wanted.views.seed, i);
    if (!server::showsModel(truth)) continue;
    const Shown alone = show(proxy, views[i], truth);
    const Shown blended = show(with_images, views[i], truth);
    save(pictures, i, "truth", truth);
    save(pictures, i, "proxy", alone.picture);
    save(pictures, i, "images", blended.picture);
    std::printf("%3zu  ", i);
    gains.add(alone, blended);
    if (patches) {
      const double psnr = show(*patches, views[i], truth).accuracy.psnr_db - alone.accuracy.psnr_db;
      std::printf("   patches %+6.2f dB", psnr);
      patch_psnr += psnr;
    }
    std::printf("\n");
    std::fflush(stdout);
  }
  if (gains.views() == 0) bench::stop("no view shows the model");
  gains.print(scene->name);
  if (patches)
    std::printf(", patches %+.2f dB at %.2f of the bytes", patch_psnr / gains.views(),
                static_cast<double>(patches->bytesReceived()) / static_cast<double>(with_images.bytesReceived()));
  std::printf("\n");
  return 0;
}
