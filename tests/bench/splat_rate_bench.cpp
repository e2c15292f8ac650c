// The frame rate of moving splats, traversal and the real renderer together, over a path whose load goes up and down in
// steps. Judged by the rate asked for: within 10 %, but where splats are as fine or as coarse as they get.
//
//   splat_rate_bench [qsplat.lgq] [--width PIXELS] [--seconds OF_A_STEP]
//
// All of the file is here from the start: this is about drawing, not about a link.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <vector>

#include "base/egl/headless.h"
#include "base/file.h"
#include "base/gl/gl.h"
#include "base/parallel.h"
#include "client/app/streamed_settings.h"
#include "client/source/streamed_splats.h"
#include "tests/bench/bench.h"
#include "tests/bench/splat_view.h"
#include "tests/support/splat_tree.h"
#include "tests/support/test_meshes.h"

namespace {
using lod::draw::SplatKernel;

constexpr double kBand = 0.1;  // share of the requested rate
constexpr int kMeanOf = 5;     // frames, when it is asked whether the rate is reached

/// A fetcher that answers at once from a local file.
class LocalFetcher final : public client::RangeFetcher {
 public:
  explicit LocalFetcher(base::ByteView file) : file_(file) {}
  void submit(std::uint64_t id, const std::string&, std::uint64_t offset, std::uint64_t length) override {
    const auto bytes = file_.subspan(static_cast<std::size_t>(offset), static_cast<std::size_t>(length));
    answers_.push_back({id, client::FetchOutcome::kBytes, {bytes.begin(), bytes.end()}, 206, ""});
  }
  std::vector<client::FetchAnswer> takeAnswers() override { return std::exchange(answers_, {}); }
  void cancel(std::uint64_t) override {}

 private:
  base::ByteView file_;
  std::vector<client::FetchAnswer> answers_;
};

/// A step of the path gives the eye's distance from the model's middle in radii.
struct Step {
  const char* name;
  double radii;
};
constexpr std::array<Step, 7> kSteps{{{"the whole", 2.5},
                                      {"near", 1.2},
                                      {"small", 6.0},
                                      {"inside", 0.5},
                                      {"middle", 0.2},
                                      {"the whole", 2.5},
                                      {"near", 1.2}}};

base::Camera cameraAt(double radii, double turn, const base::Sphere& root, int width) {
  return bench::orbitCamera(root, turn, std::atan(0.5), radii, width);
}

struct Drawn {
  double seconds = 0.0;
  client::StreamedStats stats;
};

class Viewer {
 public:
  Viewer(base::ByteView file, SplatKernel kernel, double rate, int width)
      : width_(width), target_(bench::must(base::gl::RenderTarget::create(width, width * 9 / 16))) {
    client::StreamedOptions options;
    options.kernel = kernel;
    options.frame_seconds = client::secondsPerFrame(rate);
    options.clock = [] { return bench::seconds(); };
    options.for_each = [](std::size_t n, const std::function<void(std::size_t)>& body) {
      base::parallelFor(n, 0, body);
    };
    options.memory_bytes = std::max<std::uint64_t>(8 * file.size(), options.memory_bytes);
    options.idle_bytes = ~std::uint64_t{0};
    splats_ =
        std::make_unique<client::StreamedSplats>(client::FilePlace{"here", "qsplat.lgq", file.size()},
                                                 protocol::Welcome{}, std::make_unique<LocalFetcher>(file), options);
    // Stream one view, then the rest of the file ahead.
    client::Session session({});
    for (double now = 0.0; splats_->stream().stats().present < splats_->stream().stats().blocks; now += 1.0) {
      splats_->pump(session, now);
      if (splats_->bounds() != nullptr) splats_->update(cameraAt(2.5, 0.0, *splats_->bounds(), width_), {});
    }
  }
  Drawn draw(double radii, double turn) {
    target_.bind();
    glFinish();
    const double begin = bench::seconds();
    bench::must(splats_->draw(cameraAt(radii, turn, *splats_->bounds(), width_), {}));
    glFinish();
    return {bench::seconds() - begin, splats_->stats()};
  }

 private:
  const int width_;
  base::gl::RenderTarget target_;
  std::unique_ptr<client::StreamedSplats> splats_;
};

/// Returns the number of frames until the mean of the last few is within the band; all frames if it never was.
std::size_t settledAfter(const std::vector<Drawn>& frames, double asked) {
  for (std::size_t i = 0; i < frames.size(); ++i) {
    double sum = 0.0;
    const std::size_t first = i < kMeanOf ? 0 : i + 1 - kMeanOf;
    for (std::size_t k = first; k <= i; ++k) sum += frames[k].seconds;
    if (std::abs(sum / static_cast<double>(i + 1 - first) / asked - 1.0) <= kBand) return i + 1;
  }
  return frames.size();
}

void measure(base::ByteView file, SplatKernel kernel, const char* kernel_name, double rate, int width,
             double step_seconds) {
  Viewer viewer(file, kernel, rate, width);
  const double asked = 1.0 / rate;
  double turn = 0.0;
  double all = 0.0;
  std::size_t count = 0;
  for (const Step& step : kSteps) {
    std::vector<Drawn> frames;
    std::vector<double> off;
    double spent = 0.0;
    for (; spent < step_seconds; turn += 0.02) {
      frames.push_back(viewer.draw(step.radii, turn));
      spent += frames.back().seconds;
      off.push_back(std::abs(frames.back().seconds / asked - 1.0));
    }
    const Drawn& last = frames.back();
    const bool finest = last.stats.error_px <= last.stats.finest_px;
    const bool coarsest = last.stats.error_px >= lod::qsplat::RateGoal{}.coarsest_px;
    if (!finest && !coarsest) {
      all += spent;
      count += frames.size();
    }
    std::printf("%-8s %5.0f  %-10s %6zu %8.2f %8.2f %9.1f%% %8zu %7.1f %6.1f %9llu%s\n", kernel_name, rate, step.name,
                frames.size(), static_cast<double>(frames.size()) / spent,
                static_cast<double>(frames.size()) / spent / rate, 1e2 * bench::median(off),
                settledAfter(frames, asked), static_cast<double>(last.stats.error_px),
                static_cast<double>(last.stats.splats.reduction), static_cast<unsigned long long>(last.stats.drawn),
                finest     ? "  (as fine as it gets)"
                : coarsest ? "  (as coarse as it gets)"
                           : "");
  }
  if (count > 0)
    std::printf("%-8s %5.0f  %-10s %6zu %8.2f %8.2f\n", kernel_name, rate, "all others", count,
                static_cast<double>(count) / all, static_cast<double>(count) / all / rate);
}

}  // namespace

int main(int argc, char** argv) {
  std::setvbuf(stdout, nullptr, _IOLBF, 0);  // a run takes minutes
  bench::Arguments arguments(argc, argv, "[qsplat.lgq] [--width PIXELS] [--seconds OF_A_STEP]");
  const int width = static_cast<int>(arguments.number<unsigned>("--width", 1280U, 16U, 8192U));
  const double step_seconds = arguments.number<unsigned>("--seconds", 8U, 1U, 3600U);
  arguments.finish();
  const base::Bytes bytes = arguments.input().empty() ? support::splatFile(support::bumpySphere(700, 1400))
                                                      : bench::must(base::readFile(arguments.input()));
  const auto context = bench::must(base::HeadlessContext::create());
  std::printf("%s, %u cores; %d x %d; %.0f s a step, the view turning all the while\n", context->renderer().c_str(),
              base::coreCount(), width, width * 9 / 16, step_seconds);
  std::printf("kernel    asked step       frames   rate  of asked  off, med.  settled     px  px/smp    splats\n");
  for (const double rate : {5.0, 10.0, 20.0}) measure(bytes, SplatKernel::kCircle, "circle", rate, width, step_seconds);
  measure(bytes, SplatKernel::kSquare, "square", 10.0, width, step_seconds);
  measure(bytes, SplatKernel::kEllipse, "ellipse", 10.0, width, step_seconds);
  return 0;
}
