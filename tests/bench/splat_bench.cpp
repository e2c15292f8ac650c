// Nodes a second of a traversal, on one core and on all, and splats a second drawn by each kernel. Judged by the
// paper's figure: 1.5 to 2.5 million points a second, traversal and drawing together. Before these: nodes a second that
// decoding the same blocks of the coded form makes, beside the traversal of all of them. With --saving 1, in place of
// all that: what saves how much of a frame's time, and what it does to the picture.
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <vector>

#include "base/egl/headless.h"
#include "base/file.h"
#include "base/parallel.h"
#include "compare/accuracy.h"
#include "lod/draw/splats.h"
#include "lod/qsplat/traverse.h"
#include "tests/bench/bench.h"
#include "tests/bench/splat_view.h"
#include "tests/support/coded_splats.h"
#include "tests/support/splat_tree.h"
#include "tests/support/test_meshes.h"

namespace {
using namespace lod::qsplat;
using lod::draw::SplatKernel;

constexpr int kViews = 9;

base::Camera cameraOf(const base::Sphere& root, double turn, double radii, int width) {
  return bench::orbitCamera(root, turn, std::atan(0.3), radii, width);
}

/// An off-screen picture and what draws into it.
struct Canvas {
  std::unique_ptr<base::HeadlessContext> context;
  std::unique_ptr<lod::draw::SplatRenderer> renderer;
  base::gl::RenderTarget target;

  explicit Canvas(int width)
      : context(bench::must(base::HeadlessContext::create())),
        renderer(bench::must(lod::draw::SplatRenderer::create())),
        target(bench::must(base::gl::RenderTarget::create(width, width * 9 / 16))) {}

  // Uploads and draws, waits for the GPU, and returns the time in seconds.
  double seconds(const Traversal& found, SplatKernel kernel, const base::Camera& camera, float reduction = 1.0F) {
    target.bind();
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    glFinish();
    const double start = bench::seconds();
    lod::draw::SplatView view;
    view.camera = camera;
    bench::must(renderer->draw(found.splats, kernel, view,
                               {target.framebuffer(), target.width(), target.height(), true, reduction}));
    glFinish();
    return bench::seconds() - start;
  }
};

void measure(Blocks& blocks, Canvas& canvas, double radii, float cutoff_px, int width) {
  std::vector<double> one_core, all_cores;
  std::array<std::vector<double>, 4> drawing, both;
  Traversal found;
  for (int i = 0; i < kViews; ++i) {
    TraverseRequest request;
    request.camera = cameraOf(blocks.header().root, 0.7 * i, radii, width);
    request.cutoff_px = cutoff_px;
    double start = bench::seconds(CLOCK_THREAD_CPUTIME_ID);
    traverse(blocks, request, found);
    const double walking = bench::seconds(CLOCK_THREAD_CPUTIME_ID) - start;
    one_core.push_back(1e-6 * static_cast<double>(found.nodes) / walking);
    request.for_each = [](std::size_t n, const std::function<void(std::size_t)>& body) {
      base::parallelFor(n, 0, body);
    };
    start = bench::seconds();
    traverse(blocks, request, found);
    all_cores.push_back(1e-6 * static_cast<double>(found.nodes) / (bench::seconds() - start));
    for (std::size_t k = 0; k < drawing.size(); ++k) {
      const double seconds = canvas.seconds(found, static_cast<SplatKernel>(k), request.camera);
      drawing[k].push_back(1e-6 * static_cast<double>(found.splats.size()) / seconds);
      both[k].push_back(1e-6 * static_cast<double>(found.nodes) / (seconds + walking));
    }
  }
  std::printf("%5.1f %5.1f %9llu %9zu  %6.1f %6.1f ", radii, static_cast<double>(cutoff_px),
              static_cast<unsigned long long>(found.nodes), found.splats.size(), bench::median(one_core),
              bench::median(all_cores));
  for (std::size_t k = 0; k < drawing.size(); ++k)
    std::printf("  %6.2f %6.1f", bench::median(drawing[k]), bench::median(both[k]));
  std::printf("\n");
}

/// Measures a frame's time, traversal on all cores included, and its PSNR against the finest circles, for coarser
/// splats, fewer samples, and squares.
void measureSaving(Blocks& blocks, Canvas& canvas, double radii, int width) {
  constexpr int kRuns = 3;
  TraverseRequest request;
  request.camera = cameraOf(blocks.header().root, 0.7, radii, width);
  request.for_each = [](std::size_t n, const std::function<void(std::size_t)>& body) { base::parallelFor(n, 0, body); };
  Traversal found;
  traverse(blocks, request, found);
  canvas.seconds(found, SplatKernel::kCircle, request.camera);
  const base::Image finest = canvas.target.read();
  for (const float cutoff_px : {4.0F, 8.0F, 16.0F, 32.0F, 64.0F, 100.0F}) {
    request.cutoff_px = cutoff_px;
    std::printf("%5.1f %5.0f", radii, static_cast<double>(cutoff_px));
    for (const SplatKernel kernel : {SplatKernel::kCircle, SplatKernel::kSquare})
      for (const float reduction : {1.0F, 2.0F, 4.0F, 8.0F}) {
        std::vector<double> taken;
        for (int i = 0; i < kRuns; ++i) {
          const double start = bench::seconds();
          traverse(blocks, request, found);
          const double walking = bench::seconds() - start;
          taken.push_back(walking + canvas.seconds(found, kernel, request.camera, reduction));
        }
        std::printf("  %5.0f %5.1f", 1e3 * bench::median(taken),
                    compare::measureAccuracy(finest, canvas.target.read()).value().psnr_db);
      }
    std::printf("\n");
  }
}

/// Measures CPU seconds of one core for decoding every block, and for traversing all decoded nodes, in turn.
void measureDecoding(const FileBlocks& opened, base::ByteView stored) {
  constexpr int kRuns = 5;
  const base::Bytes made = opened.header().coded() ? base::Bytes() : support::codedSplats(stored);
  const base::ByteView coded = made.empty() ? stored : base::ByteView(made);
  const Header header = bench::must(readHeader(coded));
  TraverseRequest request;
  request.camera = cameraOf(header.root, 0.7, 2.5, 1280);
  request.cutoff_px = 0.0F;
  request.cull = request.cull_back_faces = false;
  std::vector<double> decoding, walking;
  for (int run = 0; run < kRuns; ++run) {
    const auto blocks = bench::must(openBlocks(coded, header));
    double start = bench::seconds(CLOCK_THREAD_CPUTIME_ID);
    for (std::uint64_t b = 1; b < header.blocks(); ++b) blocks->find(b);
    decoding.push_back(bench::seconds(CLOCK_THREAD_CPUTIME_ID) - start);
    Traversal found;
    traverse(*blocks, request, found);
    start = bench::seconds(CLOCK_THREAD_CPUTIME_ID);
    traverse(*blocks, request, found);
    walking.push_back(bench::seconds(CLOCK_THREAD_CPUTIME_ID) - start);
  }
  const auto rate = [&](std::vector<double> seconds) {
    return 1e-6 * static_cast<double>(header.nodes) / bench::median(std::move(seconds));
  };
  const auto leaves = static_cast<double>(header.leaves);
  std::printf("bytes a leaf: %.2f plain, %.2f coded\n", static_cast<double>(header.file_bytes) / leaves,
              static_cast<double>(header.coded_bytes) / leaves);
  std::printf("one core, all nodes: decoding %.1f, traversal %.1f M nodes/s (1 to %.1f); medians of %d\n",
              rate(decoding), rate(walking), bench::median(decoding) / bench::median(walking), kRuns);
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(argc, argv, "[qsplat.lgq] [--width PIXELS] [--saving 0|1]");
  const int width = static_cast<int>(arguments.number<unsigned>("--width", 1280U, 16U, 8192U));
  const bool saving = arguments.number<unsigned>("--saving", 0U, 0U, 1U) != 0;
  arguments.finish();
  const base::Bytes bytes = arguments.input().empty() ? support::splatFile(support::bumpySphere(700, 1400))
                                                      : bench::must(base::readFile(arguments.input()));
  const auto opened_blocks = bench::must(openBlocks(bytes, bench::must(readHeader(bytes))));
  FileBlocks& blocks = *opened_blocks;
  Canvas canvas(width);

  if (saving) {
    std::printf(
        "%s, %u cores; one view each\nradii    px  ms and dB of circles with 1, 2, 4 and 8 pixels a sample; of "
        "squares\n",
        canvas.context->renderer().c_str(), base::coreCount());
    for (const double radii : {2.5, 1.2, 0.5, 0.2}) measureSaving(blocks, canvas, radii, width);
    return 0;
  }
  std::printf("%s, %u cores; %llu nodes; medians of %d views\n", canvas.context->renderer().c_str(), base::coreCount(),
              static_cast<unsigned long long>(blocks.header().nodes), kViews);
  measureDecoding(blocks, bytes);
  std::printf(
      "radii  px      nodes    splats  M nodes/s      square          circle          fuzzy           ellipse\n"
      "                                one    all  M splats/s, M nodes/s with traversal\n");
  for (const double radii : {1.2, 2.5, 10.0})
    for (const float cutoff_px : {1.0F, 4.0F, 16.0F}) measure(blocks, canvas, radii, cutoff_px, width);
  return 0;
}
