// qsplat_bench MESH [--runs N] [--only speed|size] [--memory BYTES]
// speed: `lumigrid build --methods qsplat`, disk to disk, on one core and on two, beside meshopt_simplify to 10 % of
// the same mesh in memory, run in turn; size: the file's nodes, pointers and bytes, with and without colours, as in
// figure 6 of Rusinkiewicz and Levoy 2000. With --memory the build of speed gets that much, and its peak is printed.
#include <cstdio>
#include <string>
#include <vector>

#include "lod/build/import.h"
#include "lod/build/qsplat/build.h"
#include "lod/qsplat/splat_file.h"
#include "tests/bench/bench.h"
#include "tests/bench/build_run.h"

namespace {

using bench::median;
using bench::must;
using bench::seconds;
using lod::build::Mesh;
using lod::qsplat::Header;

Header headerOf(const std::string& scene) {
  return must(lod::qsplat::SplatFile::open(scene + "/qsplat.lgq")).header();
}

void compareSpeed(const std::string& path, const Mesh& mesh, const std::string& scene, int runs,
                  const std::string& memory) {
  std::vector<std::string> more;
  if (!memory.empty()) more = {"--memory", memory};
  std::vector<double> ours, theirs, one, two;
  double peak = 0.0;
  for (int run = 0; run < runs; ++run) {
    const bench::Run single = bench::runBuild(LUMIGRID_PROGRAM, "qsplat", path, scene, 1, more);
    const bench::Run pair = bench::runBuild(LUMIGRID_PROGRAM, "qsplat", path, scene, 2, more);
    ours.push_back(single.cpu), one.push_back(single.wall), two.push_back(pair.wall);
    peak = std::max({peak, single.peak_mb, pair.peak_mb});
    const double start = seconds(CLOCK_PROCESS_CPUTIME_ID);
    (void)bench::simplifyByMeshopt(mesh, mesh.triangleCount() / 10);
    theirs.push_back(seconds(CLOCK_PROCESS_CPUTIME_ID) - start);
  }
  const auto triangles = static_cast<double>(mesh.triangleCount());
  const auto leaves = static_cast<double>(headerOf(scene).leaves);
  const double our_rate = 1e-6 * triangles / median(ours);
  const double their_rate = 1e-6 * triangles / median(theirs);
  std::printf(
      "speed, disk to disk: %.2f M vertices/s and %.2f Mtri/s per core; meshopt_simplify to 10 %% in memory: %.2f "
      "Mtri/s; ratio %.2f (wanted 0.60)\n",
      1e-6 * leaves / median(ours), our_rate, their_rate, our_rate / their_rate);
  std::printf("two cores %.2f times one (wanted 1.7); peak memory %.0f MB; medians of %d\n", median(one) / median(two),
              peak, runs);
}

void printSize(const char* what, const Header& h) {
  const auto bytes = static_cast<double>(h.file_bytes);
  std::printf(
      "%s: %llu leaves, %llu inner nodes, %u bytes a node, pointers %.2f MB (%.1f %%), file %.2f MB, %.2f bytes a "
      "leaf\n",
      what, static_cast<unsigned long long>(h.leaves), static_cast<unsigned long long>(h.nodes - h.leaves),
      h.nodeBytes(), 1e-6 * static_cast<double>(h.pointers * h.pointerBytes()),
      100.0 * static_cast<double>(h.pointers * h.pointerBytes()) / bytes, 1e-6 * bytes,
      bytes / static_cast<double>(h.leaves));
}

void compareSize(Mesh mesh, const std::string& file) {
  if (!mesh.colors.empty()) printSize("with colours", must(lod::build::qsplat::buildFromMesh(mesh, {}, file)).header);
  mesh.colors.clear();
  printSize("without colours", must(lod::build::qsplat::buildFromMesh(mesh, {}, file)).header);
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(argc, argv, "MESH [--runs N] [--only speed|size] [--memory BYTES]");
  const int runs = arguments.number("--runs", 5, 1, 100);
  const std::string only = arguments.text("--only", "");
  const std::string memory = arguments.text("--memory", "");
  arguments.finish();
  if (arguments.input().empty() || (!only.empty() && only != "speed" && only != "size")) arguments.wrong();
  const bench::WorkDirectory directory;
  const Mesh mesh = std::move(must(lod::build::importMeshes({arguments.input()}, {})).mesh);
  std::printf("%s: %zu vertices, %zu triangles\n", arguments.input().c_str(), mesh.positions.size(),
              mesh.triangleCount());
  if (only.empty() || only == "speed") compareSpeed(arguments.input(), mesh, directory / "scene", runs, memory);
  if (only.empty() || only == "size") compareSize(mesh, directory / "size.lgq");
  return 0;
}
