// How near does a whole bake come to its slower half, and how busy are the cores? Renders all faces and drops them,
// encodes kept ones again and again, then bakes, and so on: medians of --runs.
//
//   bake_bench SCENE|MESH [--grid N] [--face PIXELS] [--threads N] [--runs N]
//
// With software GL drawing and encoding share the same cores, and no overlap can beat 1 / (1 / render + 1 / encode);
// with a GPU the limit is the slower of the two. Both are printed. "Cores busy" is the bake's CPU time over its wall
// time and the cores it may use; what others take is not in it, so the time that these cores were idle is printed
// beside it.
#include <sched.h>
#include <sys/resource.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "base/egl/headless.h"
#include "base/parallel.h"
#include "repository/store.h"
#include "server/bake/bake.h"
#include "server/bake/draw_processes.h"
#include "server/bake/face_encoder.h"
#include "server/bake/face_sample.h"
#include "tests/bench/bench_scene.h"

namespace {

using bench::must;

constexpr std::size_t kKeptFaces = 240;
constexpr double kEncodeSeconds = 3.0;

struct Arguments {
  bench::FaceArguments faces;
  unsigned threads = 0;
  unsigned runs = 3;
};

Arguments parse(int argc, char** argv) {
  bench::Arguments given(argc, argv, std::string(bench::kFaceUsage) + " [--threads N] [--runs N]");
  Arguments a{bench::faceArguments(given, 6), given.number("--threads", 0U, 0U, 1024U),
              given.number("--runs", 3U, 1U, 100U)};
  given.finish();
  return a;
}

// This program, as the bake's drawing process (server/bake/draw_processes.h); "drop": it encodes nothing.
constexpr const char* kDraw = "draw";
constexpr const char* kDrop = "drop";

std::vector<std::string> self(const char* role) {
  return {std::filesystem::read_symlink("/proc/self/exe").string(), role};
}

base::Result<server::EncodedFace> dropPicture(const base::Image&, const server::FaceCoding&) {
  return server::EncodedFace{};
}

// Every face of the grid, none of them encoded: in as many processes as the bake draws in.
double renderOnly(const bench::OpenScene& open, const server::BakeOptions& options, bool in_processes) {
  const server::FaceWork work{open.scene, open.patches, options.grid, server::renderOptions(options)};
  const auto take = [](std::uint64_t, const repository::FaceKey&, const server::EncodedFace&) {};
  const auto fail = [](const base::Error& error) { bench::stop(error.message); };
  const double start = bench::seconds();
  const auto faces = in_processes
                         ? server::makeProcessFaceMaker(
                               work, self(kDrop), server::drawProcessesFor(server::threadsOf(options)), take, fail)
                         : server::makeLocalFaceMaker(work, 1, take, fail, dropPicture);
  std::uint64_t sequence = 0;
  for (const glm::uvec3& p : repository::pointsInMortonOrder(options.grid)) {
    server::DrawJob job{sequence, {}};
    for (std::uint32_t d = 0; d < 6; ++d) job.keys.push_back({p.x, p.y, p.z, d});
    faces->submit(std::move(job));
    sequence += 6;
  }
  faces->finish();
  return static_cast<double>(options.grid.faceCount()) / (bench::seconds() - start);
}

// Faces to encode, those of whole points, evenly over the grid, so that empty ones have their share.
std::vector<base::Image> keptFaces(const bench::OpenScene& open, const server::BakeOptions& options) {
  const auto renderer = must(server::SceneRenderer::create(open.scene, open.patches));
  const auto points = repository::pointsInMortonOrder(options.grid);
  const std::size_t stride = std::max<std::size_t>(1, 6 * points.size() / kKeptFaces);
  std::vector<base::Image> kept;
  for (std::size_t i = 0; i < points.size(); i += stride) {
    std::vector<repository::FaceKey> keys;
    for (std::uint32_t d = 0; d < 6; ++d) keys.push_back({points[i].x, points[i].y, points[i].z, d});
    must(renderer->renderMany(
        server::faceCameras(*renderer, options.grid, keys), server::renderOptions(options),
        [&](std::size_t, server::RenderedPicture rendered) { kept.push_back(std::move(rendered.rgba)); }));
  }
  must(renderer->finish());
  return kept;
}

double encodeOnly(const std::vector<base::Image>& faces, const server::BakeOptions& options) {
  std::size_t count = 0;
  const double start = bench::seconds();
  while (bench::seconds() - start < kEncodeSeconds) {
    base::parallelFor(faces.size(), options.limits.threads, [&](std::size_t i) {
      if (!server::encodeFace(faces[i], {options.quality, options.subsampling}))
        bench::stop("a face cannot be encoded");
    });
    count += faces.size();
  }
  return static_cast<double>(count) / (bench::seconds() - start);
}

// CPU time of this process and its children that have ended.
double cpuSeconds() {
  double sum = 0.0;
  for (const int who : {RUSAGE_SELF, RUSAGE_CHILDREN}) {
    rusage use{};
    ::getrusage(who, &use);
    sum += static_cast<double>(use.ru_utime.tv_sec + use.ru_stime.tv_sec) +
           1e-6 * static_cast<double>(use.ru_utime.tv_usec + use.ru_stime.tv_usec);
  }
  return sum;
}

// How long the cores that this process may use have been idle, all together (/proc/stat).
double idleSeconds() {
  cpu_set_t mine;
  CPU_ZERO(&mine);
  ::sched_getaffinity(0, sizeof(mine), &mine);
  std::ifstream stat("/proc/stat");
  double ticks = 0.0;
  for (std::string line; std::getline(stat, line);) {
    std::istringstream words(line);
    std::string name;
    double user = 0.0, nice = 0.0, system = 0.0, idle = 0.0, waiting = 0.0;
    words >> name >> user >> nice >> system >> idle >> waiting;
    if (!name.starts_with("cpu") || name == "cpu") continue;
    if (CPU_ISSET(std::stoul(name.substr(3)), &mine)) ticks += idle + waiting;
  }
  return ticks / static_cast<double>(::sysconf(_SC_CLK_TCK));
}

server::BakeSummary bakeAll(const bench::OpenScene& open, const server::BakeOptions& options,
                            const std::string& directory) {
  auto store = must(repository::openLmdbStore(directory, repository::StoreMode::kWrite));
  return must(
      server::bake(open.scene, open.patches, *store, options, [](const server::BakeProgress&) { return true; }));
}

// Medians of several runs, in each of which the three take turns.
struct Rates {
  std::vector<double> render, encode, bake, of_slower, of_shared, busy, idle;

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
  const std::string role = argc > 1 ? argv[1] : "";
  if (role == kDraw) return server::runDrawProcess(STDIN_FILENO);
  if (role == kDrop) return server::runDrawProcess(STDIN_FILENO, dropPicture);

  const Arguments a = parse(argc, argv);
  const bench::WorkDirectory work;
  const bench::OpenScene open = bench::openScene(a.faces.input, work);
  server::BakeOptions options;
  options.grid = repository::makeGrid(open.scene.localBox(), a.faces.grid, 0.5F, a.faces.face);
  options.limits.threads = a.threads;
  options.draw_command = self(kDraw);
  bool in_processes = false;
  std::vector<base::Image> kept;
  {
    const auto context = must(base::HeadlessContext::create());
    in_processes = context->isSoftware() && a.threads != 1;
    std::printf("GL: %s\n", context->renderer().c_str());
    kept = keptFaces(open, options);
  }

  Rates rates;
  server::BakeSummary summary;
  for (unsigned run = 0; run < a.runs; ++run) {
    const double rendering = renderOnly(open, options, in_processes);
    const double encoding = encodeOnly(kept, options);
    const double cpu = cpuSeconds();
    const double idle = idleSeconds();
    summary = bakeAll(open, options, work / ("images" + std::to_string(run)));
    const double core_seconds = summary.seconds * server::threadsOf(options);
    rates.add(rendering, encoding, static_cast<double>(summary.faces_rendered) / summary.seconds);
    rates.busy.push_back((cpuSeconds() - cpu) / core_seconds);
    rates.idle.push_back((idleSeconds() - idle) / core_seconds);
  }

  const auto images = static_cast<double>(summary.faces_rendered - summary.faces_empty);
  std::printf("faces %llu of %u pixels, %llu empty; medians of %u runs, faces a second\n",
              static_cast<unsigned long long>(summary.faces_rendered), a.faces.face,
              static_cast<unsigned long long>(summary.faces_empty), a.runs);
  print("render only", rates.render, 1);
  print("encode only", rates.encode, 1);
  print("whole bake", rates.bake, 1);
  print("bake / slower of the two", rates.of_slower, 2);
  print("bake / both on the same cores", rates.of_shared, 2);
  print("cores busy with the bake", rates.busy, 2);
  print("cores idle meanwhile", rates.idle, 2);
  std::printf("per image: JPEG %.0f bytes, mask %.0f bytes\n",
              static_cast<double>(summary.jpeg_bytes) / std::max(1.0, images),
              static_cast<double>(summary.coverage_bytes) / std::max(1.0, images));
  return 0;
}
