// pmr_bench MESH [--runs N] [--only speed|decimation] [--memory BYTES] [--chart FILE.svg]
// speed: `lumigrid build --methods pmr` of the mesh's vertices, on one core and on two, beside CGAL's bare Delaunay
// triangulation of the same points in memory, run in turn; and the rate of Dey and Hudson 2002, table 1.
// decimation: how far the source mesh is from the umbrellas of each level that `lumigrid build` made, beside those over
// as many points thinned evenly and by chance: a line of CSV for each. The chart has the larger of both ways'
// distances.
#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "base/file.h"
#include "compare/chart.h"
#include "lod/pmr/format.h"
#include "lod/pmr/leaf_picture.h"
#include "tests/bench/bench.h"
#include "tests/bench/build_run.h"
#include "tests/support/mesh_reader.h"
#include "tests/support/point_levels.h"
#include "tests/support/thinning.h"

namespace {

using bench::median;
using bench::must;
using bench::seconds;
using support::Mesh;

// Table 1: 3 h 53 min for 437 645 vertices, 1.7 GHz.
constexpr double kPaperSeconds = (3.0 * 60.0 + 53.0) * 60.0 / 437645.0;

double bareDelaunay(const std::vector<glm::vec3>& positions) {
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  std::vector<Kernel::Point_3> points;
  for (const glm::vec3& p : positions) points.emplace_back(p.x, p.y, p.z);
  const double start = seconds(CLOCK_PROCESS_CPUTIME_ID);
  const CGAL::Delaunay_triangulation_3<Kernel> delaunay(points.begin(), points.end());
  return seconds(CLOCK_PROCESS_CPUTIME_ID) - start;
}

void compareSpeed(const std::string& path, const Mesh& mesh, const std::string& scene, int runs,
                  const std::string& memory) {
  std::vector<std::string> more;
  if (!memory.empty()) more = {"--memory", memory};
  std::vector<double> ours, theirs, one, two;
  double peak = 0.0;
  for (int run = 0; run < runs; ++run) {
    theirs.push_back(bareDelaunay(mesh.positions));
    const bench::Run single = bench::runBuild(LUMIGRID_PROGRAM, "pmr", path, scene, 1, more);
    const bench::Run pair = bench::runBuild(LUMIGRID_PROGRAM, "pmr", path, scene, 2, more);
    ours.push_back(single.cpu), one.push_back(single.wall), two.push_back(pair.wall);
    peak = std::max({peak, single.peak_mb, pair.peak_mb});
  }
  const auto points = static_cast<double>(mesh.positions.size());
  const double bytes = static_cast<double>(std::filesystem::file_size(scene + "/pmr.lgm"));
  std::printf("%s: %.0f points\n", path.c_str(), points);
  std::printf(
      "  all levels, disk to disk: %.1f us a point of one core; CGAL's bare Delaunay %.1f us; ratio %.1f (wanted "
      "8.0)\n",
      1e6 * median(ours) / points, 1e6 * median(theirs) / points, median(ours) / median(theirs));
  std::printf("  on two cores %.1f us a point: %.0f times the paper's rate (wanted 300); two cores %.2f times one\n",
              1e6 * median(two) / points, kPaperSeconds / (median(two) / points), median(one) / median(two));
  std::printf("  peak memory %.0f MB, file %.2f bytes a point; medians of %d\n", peak, bytes / points, runs);
}

/// The levels of a scene's pmr.lgm, in units of the source's positions by `scale`.
class BuiltLevels {
 public:
  BuiltLevels(const std::string& scene, float scale)
      : bytes_(must(base::readFile(scene + "/pmr.lgm"))), header_(must(lod::pmr::readHeader(bytes_))), scale_(scale) {
    leaves_ =
        must(lod::pmr::readTable(header_, part(lod::pmr::kHeaderBytes, static_cast<std::size_t>(header_.table_bytes))));
    const auto described = must(base::readFile(scene + "/scene.json"));
    const auto origin = nlohmann::json::parse(described.begin(), described.end()).at("origin");
    for (int k = 0; k < 3; ++k) origin_[k] = origin.at(static_cast<std::size_t>(k)).get<float>();
  }
  std::size_t points(std::uint32_t level) const {
    std::size_t sum = 0;
    for (const lod::pmr::Leaf& leaf : leaves_) sum += leaf.pointsAt(level);
    return sum;
  }
  support::Surface surface(std::uint32_t level) const {
    support::Surface surface;
    for (std::uint32_t number = 0; number < leaves_.size(); ++number) {
      const auto bytesOf = [&](std::uint32_t chunk) -> std::optional<base::ByteView> {
        const auto place = lod::pmr::placeOf(leaves_[number], chunk);
        return part(place.offset, place.bytes);
      };
      const auto leaf = lod::pmr::decodeLeaf(header_, leaves_[number], number, level, bytesOf);
      if (!leaf.picture) bench::stop("pmr.lgm is damaged");
      const auto first = static_cast<std::uint32_t>(surface.positions.size());
      for (const auto& vertex : leaf.picture->vertices)
        surface.positions.push_back(scale_ * (origin_ + vertex.position));
      for (const std::uint16_t corner : leaf.picture->list.corners) surface.indices.push_back(first + corner);
    }
    return surface;
  }

 private:
  base::ByteView part(std::uint64_t offset, std::size_t bytes) const {
    return base::ByteView(bytes_).subspan(static_cast<std::size_t>(offset), bytes);
  }

  base::Bytes bytes_;
  lod::pmr::Header header_;
  std::vector<lod::pmr::Leaf> leaves_;
  glm::vec3 origin_{0.0F};
  float scale_ = 1.0F;
};

void compareDecimation(const std::string& path, const Mesh& mesh, const std::string& scene,
                       const std::string& chart_path) {
  // The lattice of a build: points about 64 steps apart.
  support::Surface source{mesh.positions, mesh.indices};
  double edges = 0.0;
  for (std::size_t t = 0; t < source.triangles(); ++t) edges += glm::distance(source.corner(t, 0), source.corner(t, 1));
  const auto scale = static_cast<float>(64.0 / (edges / static_cast<double>(source.triangles())));
  bench::runBuild(LUMIGRID_PROGRAM, "pmr", path, scene, 2, {});
  const BuiltLevels built(scene, scale);
  for (glm::vec3& p : source.positions) p *= scale;
  std::vector<glm::dvec3> places;
  for (const glm::vec3& p : source.positions) places.emplace_back(glm::round(p));
  std::sort(places.begin(), places.end(),
            [](const glm::dvec3& a, const glm::dvec3& b) { return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z); });
  places.erase(std::unique(places.begin(), places.end()), places.end());
  const support::PointLevels levels(std::move(places));
  const std::string name = std::filesystem::path(path).stem();
  compare::Chart chart{name + ": sampled distance of mesh and umbrellas, the larger of both ways",
                       "points left",
                       "root mean square, mean edges of the mesh",
                       true,
                       {{"by depth (pmr)", {}}, {"thinned evenly", {}}, {"thinned by chance", {}}}};
  constexpr const char* kMethods[] = {"pmr", "uniform", "random"};
  const auto print = [&](std::uint32_t level, std::size_t method, std::size_t points,
                         const support::Surface& umbrellas) {
    const auto there = sampledDistance(source, support::NearestSurface(umbrellas), 20000);
    const auto back = sampledDistance(umbrellas, support::NearestSurface(source), 20000);
    std::printf("%s,%u,%s,%zu,%.4f,%.4f,%.4f,%.4f\n", name.c_str(), level, kMethods[method], points, there.rms / 64.0,
                there.p999 / 64.0, back.rms / 64.0, back.p999 / 64.0);
    chart.series[method].points.emplace_back(static_cast<double>(points), std::max(there.rms, back.rms) / 64.0);
    std::fflush(stdout);
  };
  std::printf("mesh,level,method,points,rms,p999,rms_back,p999_back (distances in mean edges of the mesh)\n");
  for (std::uint32_t level = 1; level < lod::pmr::kLevels; ++level) {
    const std::size_t count = built.points(level);
    print(level, 0, count, built.surface(level));
    const auto evenly = support::uniformThinning(levels.places, count, 1);
    print(level, 1, evenly.size(), levels.surfaceOf(evenly));
    print(level, 2, count, levels.surfaceOf(support::randomThinning(levels.places.size(), count, 2)));
  }
  if (!chart_path.empty() && !(std::ofstream(chart_path) << compare::formatChart(chart)))
    bench::stop(chart_path + ": cannot be written");
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(argc, argv,
                             "MESH [--runs N] [--only speed|decimation] [--memory BYTES] [--chart FILE.svg]");
  const auto runs = static_cast<int>(arguments.number("--runs", 3U, 1U, 100U));
  const std::string only = arguments.text("--only", "");
  const std::string memory = arguments.text("--memory", "");
  const std::string chart = arguments.text("--chart", "");
  arguments.finish();
  if (arguments.input().empty() || (!only.empty() && only != "speed" && only != "decimation")) arguments.wrong();
  const bench::WorkDirectory directory;
  const Mesh mesh = must(support::readMesh(arguments.input())).mesh;
  if (only.empty() || only == "speed") compareSpeed(arguments.input(), mesh, directory / "scene", runs, memory);
  if (only.empty() || only == "decimation") compareDecimation(arguments.input(), mesh, directory / "scene", chart);
  return 0;
}
