// How near does a whole bake come to its slower half? Renders all faces and drops them, encodes kept ones again and
// again, then bakes, and so on: medians of --runs.
//
//   bake_bench SCENE|MESH [--grid N] [--face PIXELS] [--threads N] [--runs N]
//
// With software GL drawing and encoding share the same cores, and no overlap can beat 1 / (1 / render + 1 / encode);
// with a GPU the limit is the slower of the two. Both are printed.
#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "base/egl/headless.h"
#include "base/parallel.h"
#include "repository/store.h"
#include "server/bake/bake.h"
#include "server/bake/draw_thread.h"
#include "server/bake/face_encoder.h"
#include "tests/bench/bench_scene.h"

namespace {

using bench::must;

constexpr std::size_t kKeptFaces = 240;
constexpr double kEncodeSeconds = 3.0;

struct Arguments {
  std::string input;
  std::uint32_t grid = 6;
  std::uint32_t face = 512;
  unsigned threads = 0;
  unsigned runs = 3;
};

Arguments parse(int argc, char** argv) {
  bench::Arguments given(argc, argv, "SCENE|MESH [--grid 2..1024] [--face PIXELS] [--threads N] [--runs N]");
  Arguments a;
  a.input = given.input();
  a.grid = given.number("--grid", a.grid, 2U, 1024U);
  a.face = given.number("--face", a.face, 1U, 16384U);
  a.threads = given.number("--threads", a.threads, 0U, 1024U);
  a.runs = given.number("--runs", a.runs, 1U, 100U);
  given.finish();
  if (a.input.empty()) given.wrong();
  return a;
}

struct Rendering {
  double faces_per_second = 0.0;
  std::vector<base::Image> kept;
};

// Every face of the grid, none of them stored. Whole points are kept, evenly over the grid, so that empty faces have
// their share.
Rendering renderOnly(const bench::OpenScene& open, const server::BakeOptions& options) {
  const auto points = repository::pointsInMortonOrder(options.grid);
  const std::size_t stride = std::max<std::size_t>(1, 6 * points.size() / kKeptFaces);

  Rendering result;
  const double start = bench::seconds();
  server::DrawThread thread(
      open.scene, open.patches, options.grid, server::renderOptions(options),
      [&](std::uint64_t sequence, const repository::FaceKey&, server::Rendered rendered) {
        if (sequence / 6 % stride == 0) result.kept.push_back(std::move(rendered.rgba));
      },
      [](const base::Error& error) { bench::stop(error.message); });
  for (std::size_t p = 0; p < points.size(); ++p) {
    server::DrawJob job{6 * p, {}};
    for (std::uint32_t d = 0; d < 6; ++d) job.keys.push_back({points[p].x, points[p].y, points[p].z, d});
    thread.submit(std::move(job));
  }
  thread.finish();
  result.faces_per_second = static_cast<double>(options.grid.faceCount()) / (bench::seconds() - start);
  return result;
}

double encodeOnly(const std::vector<base::Image>& faces, const server::BakeOptions& options) {
  std::size_t count = 0;
  const double start = bench::seconds();
  while (bench::seconds() - start < kEncodeSeconds) {
    base::parallelFor(faces.size(), options.threads, [&](std::size_t i) {
      if (!server::encodeFace(faces[i], options.quality, options.subsampling)) bench::stop("a face cannot be encoded");
    });
    count += faces.size();
  }
  return static_cast<double>(count) / (bench::seconds() - start);
}

server::BakeSummary bakeAll(const bench::OpenScene& open, const server::BakeOptions& options,
                            const std::string& directory) {
  auto store = must(repository::openLmdbStore(directory, repository::StoreMode::kWrite));
  return must(
      server::bake(open.scene, open.patches, *store, options, [](const server::BakeProgress&) { return true; }));
}

// Of several runs, in each of which the three take turns.
struct Rates {
  std::vector<double> render, encode, bake, of_slower, of_shared;

  void add(double rendering, double encoding, double baking) {
    render.push_back(rendering), encode.push_back(encoding), bake.push_back(baking);
    of_slower.push_back(baking / std::min(rendering, encoding));
    of_shared.push_back(baking * (1.0 / rendering + 1.0 / encoding));
  }
};

void print(const char* name, const std::vector<double>& values, int decimals) {
  std::printf("%-34s %8.*f  (", name, decimals, bench::median(values));
  for (std::size_t i = 0; i < values.size(); ++i) std::printf("%s%.*f", i == 0 ? "" : ", ", decimals, values[i]);
  std::printf(")\n");
}

}  // namespace

int main(int argc, char** argv) {
  const Arguments a = parse(argc, argv);
  const bench::WorkDirectory work;
  const bench::OpenScene open = bench::openScene(a.input, work);
  server::BakeOptions options;
  options.grid = repository::makeGrid(open.scene.localBox(), a.grid, 0.5F, a.face);
  options.threads = a.threads;
  std::printf("GL: %s\n", must(base::HeadlessContext::create())->renderer().c_str());

  Rates rates;
  server::BakeSummary summary;
  for (unsigned run = 0; run < a.runs; ++run) {
    const Rendering rendering = renderOnly(open, options);
    const double encoding = encodeOnly(rendering.kept, options);
    summary = bakeAll(open, options, work / ("images" + std::to_string(run)));
    rates.add(rendering.faces_per_second, encoding, static_cast<double>(summary.faces_rendered) / summary.seconds);
  }

  const auto images = static_cast<double>(summary.faces_rendered - summary.faces_empty);
  std::printf("faces %llu of %u pixels, %llu empty; medians of %u runs, faces a second\n",
              static_cast<unsigned long long>(summary.faces_rendered), a.face,
              static_cast<unsigned long long>(summary.faces_empty), a.runs);
  print("render only", rates.render, 1);
  print("encode only", rates.encode, 1);
  print("whole bake", rates.bake, 1);
  print("bake / slower of the two", rates.of_slower, 2);
  print("bake / both on the same cores", rates.of_shared, 2);
  std::printf("per image: JPEG %.0f bytes, mask %.0f bytes\n",
              static_cast<double>(summary.jpeg_bytes) / std::max(1.0, images),
              static_cast<double>(summary.coverage_bytes) / std::max(1.0, images));
  return 0;
}
