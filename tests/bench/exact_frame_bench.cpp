// Exact frames of one view: how near each tolerance and number of samples comes to the truth (leaves, 4 × 4 samples)
// before coding, with triangles and milliseconds; and how near each codec and quality leaves the exact frame, with
// bytes. Run by hand: exact_frame_bench SCENE [--width PIXELS] [--repeat N]
#include <array>
#include <cstdio>
#include <vector>

#include "base/egl/headless.h"
#include "base/picture_error.h"
#include "repository/faces/frame_image.h"
#include "server/bake/frame_encoder.h"
#include "server/render/scene_renderer.h"
#include "tests/bench/bench_scene.h"
#include "tests/bench/splat_view.h"

namespace {

constexpr int kTruthSamples = 4;
constexpr std::array kTolerances = {0.5F, 0.25F, 0.125F, 0.0625F, 0.03125F, 0.0F};
constexpr std::array kSamples = {1, 2, 3, 4};
constexpr std::array kQualities = {40, 50, 60, 70, 75, 80, 85, 90, 93, 95, base::ViewDefaults::kWithoutLoss};

struct TimedPicture {
  server::RenderedPicture picture;
  double first_ms = 0.0;   ///< with the reading and upload of patches that no picture before needed
  double median_ms = 0.0;  ///< of the repetitions
};

TimedPicture renderTimed(server::SceneRenderer& renderer, const base::Camera& camera, float tolerance, int samples,
                         int repeat) {
  const server::RenderOptions options{.tolerance_px = tolerance, .supersampling = samples};
  TimedPicture result;
  std::vector<double> times;
  for (int i = 0; i <= repeat; ++i) {
    const double start = bench::seconds();
    result.picture = bench::must(renderer.render(camera, options));
    const double ms = 1e3 * (bench::seconds() - start);
    if (i == 0)
      result.first_ms = ms;
    else
      times.push_back(ms);
  }
  result.median_ms = bench::median(times);
  return result;
}

void printTolerances(server::SceneRenderer& renderer, const base::Camera& camera, const TimedPicture& truth,
                     int repeat) {
  std::printf("%9s %8s %12s %8s %10s %10s\n", "tolerance", "samples", "triangles", "dB", "first ms", "median ms");
  for (const float tolerance : kTolerances)
    for (const int samples : kSamples) {
      const TimedPicture timed = renderTimed(renderer, camera, tolerance, samples, repeat);
      std::printf("%9g %3d x %-2d %12llu %8.2f %10.0f %10.0f\n", static_cast<double>(tolerance), samples, samples,
                  static_cast<unsigned long long>(timed.picture.triangles),
                  base::foregroundError(truth.picture.rgba, timed.picture.rgba).psnr(), timed.first_ms,
                  timed.median_ms);
    }
  const TimedPicture denser = renderTimed(renderer, camera, 0.0F, 2 * kTruthSamples, 1);
  std::printf("the truth against %d x %d samples: %.2f dB\n", 2 * kTruthSamples, 2 * kTruthSamples,
              base::foregroundError(denser.picture.rgba, truth.picture.rgba).psnr());
}

void printExactFrame(server::SceneRenderer& renderer, const base::Camera& camera, const TimedPicture& truth) {
  const double start = bench::seconds();
  const auto frame = bench::must(renderer.render(camera, server::exactFrameOptions(camera.width, camera.height)));
  std::printf("the exact frame: %llu triangles, %.2f dB, %.0f ms; the first picture of leaves took %.0f ms\n",
              static_cast<unsigned long long>(frame.triangles),
              base::foregroundError(truth.picture.rgba, frame.rgba).psnr(), 1e3 * (bench::seconds() - start),
              truth.first_ms);
}

void printCodecs(const TimedPicture& truth) {
  std::printf("%8s %8s %10s %8s %10s\n", "codec", "quality", "bytes", "dB", "encode ms");
  for (const auto codec : {protocol::FrameCodec::kWebp, protocol::FrameCodec::kJpeg})
    for (const int quality : kQualities) {
      const double start = bench::seconds();
      const base::Bytes value = bench::must(server::encodeFrame(truth.picture.rgba, codec, quality)).value;
      const double ms = 1e3 * (bench::seconds() - start);
      const base::Image decoded = bench::must(repository::decodeFrameImage(value, base::ViewDefaults::kMaxFramePixels));
      std::printf("%8s %8d %10zu %8.2f %10.0f\n", codec == protocol::FrameCodec::kWebp ? "WebP" : "JPEG", quality,
                  value.size(), base::foregroundError(truth.picture.rgba, decoded).psnr(), ms);
    }
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(argc, argv, "SCENE [--width PIXELS] [--repeat N]");
  const auto width = static_cast<int>(arguments.number("--width", 1280U, 16U, 16384U));
  const auto repeat = static_cast<int>(arguments.number("--repeat", 3U, 1U, 100U));
  arguments.finish();
  const bench::WorkDirectory work;
  const bench::OpenScene open = bench::openScene(arguments.input(), work);
  auto context = bench::must(base::HeadlessContext::create());
  auto renderer = bench::must(server::SceneRenderer::create(open.scene, open.patches));

  // Half a diagonal away is the sphere's radius.
  const base::Sphere model{renderer->sceneCenter(), renderer->sceneRadius()};
  const base::Camera camera = bench::orbitCamera(model, 0.6, 0.6, 1.0, width);
  std::printf("%s; %s, %d x %d\n", context->renderer().c_str(), arguments.input().c_str(), camera.width, camera.height);
  const TimedPicture truth = renderTimed(*renderer, camera, 0.0F, kTruthSamples, repeat);
  printTolerances(*renderer, camera, truth, repeat);
  printExactFrame(*renderer, camera, truth);
  printCodecs(truth);
}
