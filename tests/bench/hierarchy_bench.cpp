// hierarchy_bench MESH [RUNS] [--only speed,size,accuracy,bounds] [--peer MESH] [--chart FILE.svg] [--csv FILE.csv]
// speed: the whole `lumigrid build`, disk to disk, beside meshopt_simplify to 10 % of the same mesh (or of the peer's)
// in memory, run in turn; size: its bytes and how fast they decode; accuracy: beside meshopt_simplify and OpenMesh's
// quadric decimater at the same number of triangles, and the paper's binary tree; bounds: its stated errors beside
// sampled ones, and the binary tree's triangles beside ours. Without --only: all of them.
#include <meshoptimizer.h>
#include <unistd.h>

#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Tools/Decimater/DecimaterT.hh>
#include <OpenMesh/Tools/Decimater/ModQuadricT.hh>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "compare/chart.h"
#include "lod/patch/builder/hierarchy_build.h"
#include "lod/patch/codec.h"
#include "lod/patch/format.h"
#include "lod/patch/traverse.h"
#include "tests/bench/bench.h"
#include "tests/bench/build_run.h"
#include "tests/lod/patch/builder/built_cut.h"
#include "tests/support/mesh_reader.h"

namespace {

using bench::median;
using bench::seconds;
using namespace lod::patch::builder;
using support::BuiltHierarchy;
using support::Mesh;

Mesh mustImport(const std::string& path) {
  Mesh mesh = bench::must(support::readMesh(path)).mesh;
  std::printf("%s: %zu triangles\n", path.c_str(), mesh.triangleCount());
  return mesh;
}

// ---- Speed

using bench::Run;

Run runProgram(const std::string& mesh, const std::string& scene, int threads, const std::vector<std::string>& more) {
  return bench::runBuild(LUMIGRID_PROGRAM, "patch", mesh, scene, threads, more);
}

using bench::simplifyByMeshopt;

// The triangles of a scene's leaves: those of the source but for the ones that repairs removed.
std::uint64_t leafTriangles(const std::string& scene) {
  const auto file = lod::patch::PatchFile::open(scene + "/patch.lgp");
  if (!file) std::exit((std::fprintf(stderr, "%s\n", file.error().message.c_str()), 1));
  return lod::patch::selectUniformCut(file->hierarchy(), 0.0F).triangles;
}

// `peer`: the mesh that meshopt_simplify gets, which may be another one than ours.
void compareSpeed(const std::string& path, const Mesh& peer, const std::string& scene, int runs) {
  std::vector<double> ours, theirs, one, two;
  double peak = 0.0;
  for (int run = 0; run < runs; ++run) {
    const Run single = runProgram(path, scene, 1, {});
    const Run pair = runProgram(path, scene, 2, {});
    ours.push_back(single.cpu), one.push_back(single.wall), two.push_back(pair.wall);
    peak = std::max({peak, single.peak_mb, pair.peak_mb});
    const double start = seconds(CLOCK_PROCESS_CPUTIME_ID);
    (void)simplifyByMeshopt(peer, peer.triangleCount() / 10);
    theirs.push_back(seconds(CLOCK_PROCESS_CPUTIME_ID) - start);
  }
  const double our_rate = 1e-6 * static_cast<double>(leafTriangles(scene)) / median(ours);
  const double their_rate = 1e-6 * static_cast<double>(peer.triangleCount()) / median(theirs);
  std::printf(
      "speed, disk to disk: %.3f Mtri/s per core; meshopt_simplify to 10 %% of %zu triangles in memory: %.3f; ratio "
      "%.2f (wanted 0.55)\n",
      our_rate, peer.triangleCount(), their_rate, our_rate / their_rate);
  std::printf("two cores %.2f times one (wanted 1.7); peak memory %.0f MB; medians of %d\n", median(one) / median(two),
              peak, runs);
}

// ---- Size

void compareSize(const std::string& path, const std::string& scene) {
  (void)runProgram(path, scene, static_cast<int>(sysconf(_SC_NPROCESSORS_ONLN)), {"--position-bits", "14"});
  const auto file = lod::patch::PatchFile::open(scene + "/patch.lgp");
  if (!file) std::exit((std::fprintf(stderr, "%s\n", file.error().message.c_str()), 1));
  std::uint64_t triangles = 0, colorless = 0;
  std::vector<base::Bytes> patches;
  for (std::uint32_t p = 0; p < file->hierarchy().patches.size(); ++p) {
    auto geometry = file->geometry(p);
    if (!geometry) std::exit(1);
    triangles += geometry->indices.size() / 3;
    patches.push_back(lod::patch::encodePatch(*geometry));
    geometry->colors.clear();
    colorless += lod::patch::encodePatch(*geometry).size();
  }
  std::vector<double> times;
  for (int run = 0; run < 5; ++run) {
    const double start = seconds(CLOCK_PROCESS_CPUTIME_ID);
    for (const base::Bytes& bytes : patches)
      if (!lod::patch::decodePatch(bytes)) std::exit(1);
    times.push_back(seconds(CLOCK_PROCESS_CPUTIME_ID) - start);
  }
  const auto source = static_cast<double>(leafTriangles(scene));
  std::printf(
      "size at 14 bits: %.2f bytes per source triangle in all; without colours %.2f (wanted 5.0, 1.0 more with "
      "colours); decodes %.0f Mtri/s (wanted 100)\n",
      static_cast<double>(file->fileBytes()) / source, static_cast<double>(colorless) / source,
      1e-6 * static_cast<double>(triangles) / median(times));
}

// ---- Accuracy

struct TwoSided {
  double mean = 0.0;
  double rms = 0.0;
  double p95 = 0.0;
  double p999 = 0.0;
  double max = 0.0;
  double there_mean = 0.0, there_max = 0.0;  // from the source alone
};
TwoSided twoSided(const support::Surface& source, const support::NearestSurface& to_source,
                  const support::Surface& result) {
  const support::NearestSurface to_result(result);
  const auto there = support::sampledDistance(source, to_result, 200'000);
  const auto back = support::sampledDistance(result, to_source, 200'000);
  return {0.5 * (there.mean + back.mean),
          std::sqrt(0.5 * (there.rms * there.rms + back.rms * back.rms)),
          std::max(there.p95, back.p95),
          std::max(there.p999, back.p999),
          std::max(there.max, back.max),
          there.mean,
          there.max};
}

support::Surface simplifyByOpenMesh(const Mesh& mesh, std::size_t triangles) {
  using HalfEdgeMesh = OpenMesh::TriMesh_ArrayKernelT<>;
  HalfEdgeMesh m;
  std::vector<HalfEdgeMesh::VertexHandle> vertices;
  for (const glm::vec3& p : mesh.positions) vertices.push_back(m.add_vertex({p.x, p.y, p.z}));
  for (std::size_t i = 0; i < mesh.indices.size(); i += 3) {
    const std::uint32_t* t = &mesh.indices[i];
    if (m.add_face(vertices[t[0]], vertices[t[1]], vertices[t[2]]).is_valid()) continue;
    // A triangle that would make the mesh non-manifold gets corners of its own, as OpenMesh's own readers do it.
    const auto corner = [&](std::size_t k) { return m.add_vertex(m.point(vertices[t[k]])); };
    const auto a = corner(0), b = corner(1), c = corner(2);
    m.add_face(a, b, c);
  }
  OpenMesh::Decimater::DecimaterT<HalfEdgeMesh> decimater(m);
  OpenMesh::Decimater::ModQuadricT<HalfEdgeMesh>::Handle quadric;
  decimater.add(quadric);
  decimater.module(quadric).unset_max_err();
  decimater.initialize();
  decimater.decimate_to_faces(0, triangles);
  m.garbage_collection();
  support::Surface out;
  for (const auto v : m.vertices()) out.positions.emplace_back(m.point(v)[0], m.point(v)[1], m.point(v)[2]);
  for (const auto f : m.faces())
    for (const auto v : m.fv_range(f)) out.indices.push_back(static_cast<std::uint32_t>(v.idx()));
  return out;
}

// Returns the uniform cut with at most so many triangles, found by bisection of its error.
std::vector<std::uint32_t> cutOf(const BuiltHierarchy& built, std::size_t triangles) {
  float low = 0.0F;
  float high = built.summary.levels.back().max_error;
  for (int i = 0; i < 40; ++i) {
    const float middle = 0.5F * (low + high);
    (lod::patch::selectUniformCut(built.hierarchy, middle).triangles <= triangles ? high : low) = middle;
  }
  return lod::patch::selectUniformCut(built.hierarchy, high).patches;
}

// The meshes and hierarchies that both accuracy and bounds compare.
struct ComparedMeshes {
  explicit ComparedMeshes(const Mesh& m)
      : mesh(m),
        built(mustBuild(m, true)),
        tree(mustBuild(m, false)),
        source(support::surfaceOf(m)),
        to_source(source),
        diagonal(m.box().diagonal()) {}

  static BuiltHierarchy mustBuild(const Mesh& mesh, bool regroup) {
    HierarchyOptions options;
    options.regroup = regroup;
    return bench::must(support::builtHierarchy(mesh, options));
  }

  const Mesh& mesh;
  const BuiltHierarchy built, tree;
  const support::Surface source;
  const support::NearestSurface to_source;
  const double diagonal;
};

void compareAccuracy(const ComparedMeshes& compared, const std::string& chart_path, const std::string& csv_path) {
  const auto& [mesh, built, tree, source, to_source, diagonal] = compared;
  compare::Chart chart{
      "Triangles against distance from the source",
      "triangles",
      "log10 of mean distance / diagonal",
      true,
      {{"Lumigrid", {}}, {"binary tree (paper)", {}}, {"meshopt_simplify", {}}, {"OpenMesh quadrics", {}}}};
  std::FILE* csv = csv_path.empty() ? nullptr : std::fopen(csv_path.c_str(), "w");
  if (csv != nullptr) std::fprintf(csv, "method,triangles,mean,p999,max,source_mean,source_max\n");
  auto note = [&](std::size_t series, const support::Surface& s, const TwoSided& d) {
    if (d.mean > 0.0)
      chart.series[series].points.emplace_back(static_cast<double>(s.triangles()), std::log10(d.mean / diagonal));
    if (csv != nullptr)
      std::fprintf(csv, "%s,%zu,%.4e,%.4e,%.4e,%.4e,%.4e\n", chart.series[series].name.c_str(), s.triangles(),
                   d.mean / diagonal, d.p999 / diagonal, d.max / diagonal, d.there_mean / diagonal,
                   d.there_max / diagonal);
  };

  std::printf(
      "accuracy, sampled both ways, shares of the diagonal (wanted at 10 %% of closed meshes: mean 0.55 of "
      "meshopt's, 0.85 of OpenMesh's):\n");
  for (const double share : {0.5, 0.25, 0.1, 0.03, 0.01}) {
    const auto wanted = static_cast<std::size_t>(share * static_cast<double>(mesh.triangleCount()));
    const support::Surface result = support::surfaceOf(built, cutOf(built, wanted));
    const TwoSided ours = twoSided(source, to_source, result);
    note(0, result, ours);
    const support::Surface papers = support::surfaceOf(tree, cutOf(tree, wanted));
    if (papers.triangles() > 0) note(1, papers, twoSided(source, to_source, papers));
    const support::Surface meshopt{mesh.positions, simplifyByMeshopt(mesh, result.triangles())};
    const TwoSided theirs = twoSided(source, to_source, meshopt);
    note(2, meshopt, theirs);
    std::printf(
        "  %5.1f %%: %zu triangles, mean %.2e, max %.2e; meshopt %zu: mean ratio %.2f, max ratio %.2f; from the "
        "source alone %.2f, %.2f",
        100.0 * share, result.triangles(), ours.mean / diagonal, ours.max / diagonal, meshopt.triangles(),
        ours.mean / theirs.mean, ours.max / theirs.max, ours.there_mean / theirs.there_mean,
        ours.there_max / theirs.there_max);
    const support::Surface openmesh = simplifyByOpenMesh(mesh, result.triangles());
    if (openmesh.triangles() > 0) {
      const TwoSided quadrics = twoSided(source, to_source, openmesh);
      note(3, openmesh, quadrics);
      std::printf("; OpenMesh %zu: %.2f, %.2f\n", openmesh.triangles(), ours.mean / quadrics.mean,
                  ours.max / quadrics.max);
    } else {
      std::printf("; OpenMesh refuses the mesh\n");
    }
  }
  if (csv != nullptr) std::fclose(csv);
  if (chart_path.empty()) return;
  std::erase_if(chart.series, [](const compare::Series& s) { return s.points.empty(); });
  const std::string svg = compare::formatChart(chart);
  if (std::FILE* out = std::fopen(chart_path.c_str(), "w"); out != nullptr) {
    std::fwrite(svg.data(), 1, svg.size(), out);
    std::fclose(out);
  }
}

void compareBounds(const ComparedMeshes& compared) {
  const auto& [mesh, built, tree, source, to_source, diagonal] = compared;
  std::printf(
      "stated errors beside sampled distances, by level (wanted: the bound never below the largest, the lattice's %.1e "
      "aside; nineteen of twenty within twice the typical one):\n",
      built.hierarchy.lattice.positionError() / diagonal);
  for (std::uint32_t level = 1; level < built.summary.levels.size(); ++level) {
    const support::Surface cut = support::surfaceOf(built, support::levelCut(built.hierarchy, level));
    const TwoSided d = twoSided(source, to_source, cut);
    const auto stated = static_cast<double>(built.summary.levels[level].max_error);
    const double typical = support::typicalErrorOf(built.hierarchy, level);
    std::printf(
        "  level %2u: %9zu triangles (binary tree %9zu), bound %.2e, largest %.2e, 99.9th %.2e, ratio %.1f; typical "
        "%.2e, root mean square %.2e, ratio %.2f; 95th %.2e, over twice typical %.2f\n",
        level, cut.triangles(),
        level < tree.summary.levels.size() ? static_cast<std::size_t>(tree.summary.levels[level].triangles)
                                           : std::size_t{0},
        stated / diagonal, d.max / diagonal, d.p999 / diagonal, stated / d.p999, typical / diagonal, d.rms / diagonal,
        typical / d.rms, d.p95 / diagonal, d.p95 / (2.0 * typical));
  }
}

}  // namespace

int main(int count, char** arguments) {
  std::string mesh_path, peer_path, chart, csv, only = "speed,size,accuracy,bounds";
  int runs = 3;
  for (int i = 1; i < count; ++i) {
    const std::string a = arguments[i];
    if (a == "--chart" && i + 1 < count)
      chart = arguments[++i];
    else if (a == "--csv" && i + 1 < count)
      csv = arguments[++i];
    else if (a == "--only" && i + 1 < count)
      only = arguments[++i];
    else if (a == "--peer" && i + 1 < count)
      peer_path = arguments[++i];
    else if (mesh_path.empty())
      mesh_path = a;
    else
      runs = std::max(1, std::atoi(a.c_str()));
  }
  std::set<std::string> sections;
  std::istringstream names(only);
  for (std::string name; std::getline(names, name, ',');) sections.insert(name);
  const bool known = std::all_of(sections.begin(), sections.end(), [](const std::string& s) {
    return s == "speed" || s == "size" || s == "accuracy" || s == "bounds";
  });
  if (mesh_path.empty() || sections.empty() || !known)
    return std::fprintf(stderr,
                        "usage: hierarchy_bench MESH [RUNS] [--only speed,size,accuracy,bounds] [--peer MESH]\n"
                        "                       [--chart SVG] [--csv CSV]\n"),
           2;

  const std::string scene =
      (std::filesystem::temp_directory_path() / ("hierarchy_bench_" + std::to_string(getpid()))).string();
  if (sections.contains("speed"))
    compareSpeed(mesh_path, mustImport(peer_path.empty() ? mesh_path : peer_path), scene, runs);
  if (sections.contains("size")) compareSize(mesh_path, scene);
  std::filesystem::remove_all(scene);
  if (!sections.contains("accuracy") && !sections.contains("bounds")) return 0;
  const Mesh mesh = mustImport(mesh_path);
  const ComparedMeshes compared(mesh);
  if (sections.contains("accuracy")) compareAccuracy(compared, chart, csv);
  if (sections.contains("bounds")) compareBounds(compared);
  return 0;
}
