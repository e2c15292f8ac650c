// How near does a whole bake come to its slower half? Renders all faces and drops them, encodes kept ones again and
// again, then bakes, all in one run on one machine.
//
//   bake_bench SCENE|MESH [--grid N] [--face PIXELS] [--threads N]
//
// With software GL drawing and encoding share the same cores, and no overlap can beat 1 / (1 / render + 1 / encode);
// with a GPU the limit is the slower of the two. Both are printed.
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <string>
#include <vector>

#include "base/egl/headless.h"
#include "base/parallel.h"
#include "lod/build/hierarchy_build.h"
#include "lod/build/import.h"
#include "repository/store.h"
#include "server/bake/bake.h"
#include "server/bake/draw_pool.h"
#include "server/bake/face_encoder.h"

namespace {

constexpr std::size_t kKeptFaces = 240;
constexpr double kEncodeSeconds = 3.0;

struct Arguments {
  std::string input;
  std::uint32_t grid = 6;
  std::uint32_t face = 512;
  unsigned threads = 0;
};

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

[[noreturn]] void stop(const std::string& message) {
  std::fprintf(stderr, "bake_bench: %s\n", message.c_str());
  std::exit(1);
}

template <class T>
T must(base::Result<T> result) {
  if (!result) stop(result.error().message);
  return std::move(*result);
}

Arguments parse(int argc, char** argv) {
  Arguments a;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const auto next = [&] {
      return i + 1 < argc ? static_cast<std::uint32_t>(std::strtoul(argv[++i], nullptr, 10)) : 0U;
    };
    if (word == "--grid") {
      a.grid = next();
    } else if (word == "--face") {
      a.face = next();
    } else if (word == "--threads") {
      a.threads = next();
    } else {
      a.input = word;
    }
  }
  if (a.input.empty() || a.grid < 2 || a.face < 1)
    stop("bake_bench SCENE|MESH [--grid N] [--face PIXELS] [--threads N]");
  return a;
}

// A scene as it lies on disk, or one built from a mesh into `work`.
base::Scene openScene(const Arguments& a, const std::string& work, std::string& patch_path) {
  if (std::filesystem::is_directory(a.input)) {
    patch_path = a.input + "/patch.lgp";
    return must(base::readScene(a.input));
  }
  const lod::build::Imported imported = must(lod::build::importMeshes({a.input}, {}));
  patch_path = work + "/patch.lgp";
  must(lod::build::buildHierarchy(imported.mesh, {}, patch_path));
  base::Scene scene;
  scene.origin = imported.mesh.origin;
  scene.box_min = scene.origin + glm::dvec3(imported.mesh.box().min);
  scene.box_max = scene.origin + glm::dvec3(imported.mesh.box().max);
  scene.has_colors = !imported.mesh.colors.empty();
  scene.light.mode = scene.has_colors ? base::LightMode::kUnlit : base::LightMode::kSoft;
  return scene;
}

struct Rendering {
  double faces_per_second = 0.0;
  std::vector<base::Image> kept;
};

// Every face of the grid, none of them stored, by as many drawing threads as a bake has. Whole points are kept, evenly
// over the grid, so that empty faces have their share.
Rendering renderOnly(const base::Scene& scene, const lod::patch::PatchFile& patches,
                     const server::BakeOptions& options) {
  std::printf("GL: %s\n", must(base::HeadlessContext::create())->renderer().c_str());
  const auto points = repository::pointsInMortonOrder(options.grid);
  const std::size_t stride = std::max<std::size_t>(1, 6 * points.size() / kKeptFaces);
  const unsigned threads = options.threads == 0 ? base::coreCount() : options.threads;

  Rendering result;
  std::mutex mutex;
  const double start = now();
  server::DrawPool pool(
      scene, patches, options.grid, server::renderOptions(options), must(server::DrawPool::threadsFor(threads)),
      [&](std::uint64_t sequence, const repository::FaceKey&, server::Rendered rendered) {
        if (sequence / 6 % stride != 0) return;
        const std::lock_guard lock(mutex);
        result.kept.push_back(std::move(rendered.rgba));
      },
      [](const base::Error& error) { stop(error.message); });
  for (std::size_t p = 0; p < points.size(); ++p) {
    server::DrawJob job{6 * p, {}};
    for (std::uint32_t d = 0; d < 6; ++d) job.keys.push_back({points[p].x, points[p].y, points[p].z, d});
    pool.submit(std::move(job));
  }
  pool.finish();
  result.faces_per_second = static_cast<double>(options.grid.faceCount()) / (now() - start);
  return result;
}

double encodeOnly(const std::vector<base::Image>& faces, const server::BakeOptions& options) {
  std::size_t count = 0;
  const double start = now();
  while (now() - start < kEncodeSeconds) {
    base::parallelFor(faces.size(), options.threads, [&](std::size_t i) {
      if (!server::encodeFace(faces[i], options.quality, options.subsampling)) stop("a face cannot be encoded");
    });
    count += faces.size();
  }
  return static_cast<double>(count) / (now() - start);
}

}  // namespace

int main(int argc, char** argv) {
  const Arguments a = parse(argc, argv);
  const std::string work =
      (std::filesystem::temp_directory_path() / ("bake_bench_" + std::to_string(::getpid()))).string();
  std::filesystem::create_directories(work);
  std::string patch_path;
  const base::Scene scene = openScene(a, work, patch_path);
  const lod::patch::PatchFile patches = must(lod::patch::PatchFile::open(patch_path));
  server::BakeOptions options;
  options.grid = repository::makeGrid(scene.localBox(), a.grid, 0.5F, a.face);
  options.threads = a.threads;

  const Rendering rendering = renderOnly(scene, patches, options);
  const double encoding = encodeOnly(rendering.kept, options);
  auto store = must(repository::openLmdbStore(work + "/images", repository::StoreMode::kWrite));
  const server::BakeSummary summary =
      must(server::bake(scene, patches, *store, options, [](const server::BakeProgress&) { return true; }));
  store.reset();
  std::filesystem::remove_all(work);

  const double baking = static_cast<double>(summary.faces_rendered) / summary.seconds;
  const double slower = std::min(rendering.faces_per_second, encoding);
  const double shared = 1.0 / (1.0 / rendering.faces_per_second + 1.0 / encoding);
  const auto images = static_cast<double>(summary.faces_rendered - summary.faces_empty);
  std::printf("faces %llu of %u pixels, %llu empty\n", static_cast<unsigned long long>(summary.faces_rendered), a.face,
              static_cast<unsigned long long>(summary.faces_empty));
  std::printf("render only  %8.1f faces/s\nencode only  %8.1f faces/s\nwhole bake   %8.1f faces/s\n",
              rendering.faces_per_second, encoding, baking);
  std::printf("bake / slower of the two %.2f; bake / both on the same cores %.2f\n", baking / slower, baking / shared);
  std::printf("per image: JPEG %.0f bytes, mask %.0f bytes\n",
              static_cast<double>(summary.jpeg_bytes) / std::max(1.0, images),
              static_cast<double>(summary.coverage_bytes) / std::max(1.0, images));
  return 0;
}
