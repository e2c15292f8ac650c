// hierarchy_bench MESH [RUNS]: buildHierarchy beside meshopt_simplify to 10 % on the same mesh, run in turn on one
// thread; then the accuracy of both at 10 % and 1 %, sampled both ways as a share of the bounding box's diagonal, and
// how tight the stated errors are.
#include <meshoptimizer.h>
#include <time.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "lod/build/hierarchy_build.h"
#include "lod/build/import.h"
#include "lod/patch/traverse.h"
#include "tests/lod/build/built_cut.h"

namespace {

using namespace lod::build;

double cpuSeconds() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

std::vector<unsigned> simplifyByMeshopt(const Mesh& mesh, std::size_t triangles) {
  std::vector<unsigned> out(mesh.indices.size());
  const std::size_t left = meshopt_simplify(out.data(), mesh.indices.data(), mesh.indices.size(), &mesh.positions[0].x,
                                            mesh.positions.size(), sizeof(glm::vec3), 3 * triangles, 1.0F, 0, nullptr);
  out.resize(left);
  return out;
}

void timeBoth(const Mesh& mesh, int runs) {
  std::vector<double> ours;
  std::vector<double> theirs;
  HierarchyOptions options;
  options.threads = 1;
  const std::string path = "hierarchy_bench.lgp";
  for (int run = 0; run < runs; ++run) {
    const auto summary = buildHierarchy(mesh, options, path);
    if (!summary) std::exit((std::fprintf(stderr, "%s\n", summary.error().message.c_str()), 1));
    ours.push_back(summary->cpu_seconds);
    const double start = cpuSeconds();
    (void)simplifyByMeshopt(mesh, mesh.triangleCount() / 10);
    theirs.push_back(cpuSeconds() - start);
    if (run == 0) {
      std::printf("level  triangles  patches  stated error\n");
      for (std::size_t l = 0; l < summary->levels.size(); ++l)
        std::printf("%5zu %10zu %8zu  %.3e\n", l, static_cast<std::size_t>(summary->levels[l].triangles),
                    static_cast<std::size_t>(summary->levels[l].patches),
                    static_cast<double>(summary->levels[l].max_error));
      std::printf("%.2f bytes per triangle, %zu runs\n",
                  static_cast<double>(summary->bytes) / static_cast<double>(mesh.triangleCount()),
                  static_cast<std::size_t>(runs));
    }
  }
  std::remove(path.c_str());
  const double million = 1e-6 * static_cast<double>(mesh.triangleCount());
  std::printf("buildHierarchy %.3f, meshopt_simplify to 10 %% %.3f Mtri/s per core; ratio %.2f\n",
              million / median(ours), million / median(theirs), median(theirs) / median(ours));
}

struct TwoSided {
  double mean = 0.0;
  double max = 0.0;
};
TwoSided twoSided(const support::Surface& source, const support::NearestSurface& to_source,
                  const support::Surface& result) {
  const support::NearestSurface to_result(result);
  const auto there = support::sampledDistance(source, to_result, 200'000);
  const auto back = support::sampledDistance(result, to_source, 200'000);
  return {0.5 * (there.mean + back.mean), std::max(there.max, back.max)};
}

// The uniform cut with at most so many triangles, by bisection of its error.
std::vector<std::uint32_t> cutOf(const BuiltHierarchy& built, std::size_t triangles) {
  float low = 0.0F;
  float high = built.summary.levels.back().max_error;
  for (int i = 0; i < 40; ++i) {
    const float middle = 0.5F * (low + high);
    (lod::patch::selectUniformCut(built.hierarchy, middle).triangles <= triangles ? high : low) = middle;
  }
  return lod::patch::selectUniformCut(built.hierarchy, high).patches;
}

float statedError(const BuiltHierarchy& built, const std::vector<std::uint32_t>& cut) {
  float stated = 0.0F;
  for (const std::uint32_t p : cut)
    if (const std::uint32_t g = built.hierarchy.patches[p].producer; g != lod::patch::kNoGroup)
      stated = std::max(stated, built.hierarchy.groups[g].error);
  return stated;
}

void compareAccuracy(const Mesh& mesh) {
  const auto built = buildHierarchyInMemory(mesh, {});
  if (!built) return;
  const support::Surface source = support::surfaceOf(mesh);
  const support::NearestSurface to_source(source);
  const double diagonal = mesh.box().diagonal();
  for (const double share : {0.1, 0.01}) {
    const auto wanted = static_cast<std::size_t>(share * static_cast<double>(mesh.triangleCount()));
    const auto cut = cutOf(*built, wanted);
    const support::Surface result = support::surfaceOf(*built, cut);
    const TwoSided ours = twoSided(source, to_source, result);
    const support::Surface simplified{mesh.positions, simplifyByMeshopt(mesh, result.triangles())};
    const TwoSided theirs = twoSided(source, to_source, simplified);
    std::printf(
        "to %4.1f %% (%zu triangles): mean %.2e, max %.2e, stated %.2e; meshopt_simplify (%zu): mean %.2e, max %.2e\n",
        100.0 * share, result.triangles(), ours.mean / diagonal, ours.max / diagonal,
        static_cast<double>(statedError(*built, cut)) / diagonal, simplified.triangles(), theirs.mean / diagonal,
        theirs.max / diagonal);
  }
}

}  // namespace

int main(int count, char** arguments) {
  if (count < 2) return std::fprintf(stderr, "usage: hierarchy_bench MESH [RUNS]\n"), 2;
  const auto imported = importMeshes({arguments[1]}, {});
  if (!imported) return std::fprintf(stderr, "%s\n", imported.error().message.c_str()), 1;
  std::printf("%s: %zu triangles\n", arguments[1], imported->mesh.triangleCount());
  timeBoth(imported->mesh, count > 2 ? std::max(1, std::atoi(arguments[2])) : 5);
  compareAccuracy(imported->mesh);
  return 0;
}
