// qsplat_bench MESH [--runs N] [--only speed|size] [--memory BYTES] [--dice FACTOR]
// speed: `lumigrid build --methods qsplat`, disk to disk, on one core and on two, beside meshopt_simplify to 10 % of
// the same mesh in memory, run in turn; size: the file's nodes, pointers and bytes, with and without colours, as in
// figure 6 of Rusinkiewicz and Levoy 2000, and how large nodes are beside their leaves. With --memory the build of
// speed gets that much, and its peak is printed.
// --dice: as --qsplat-dice; 0 makes of each vertex a leaf, as the original qsplat_make does.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "lod/qsplat/builder/build.h"
#include "lod/qsplat/splat_file.h"
#include "tests/bench/bench.h"
#include "tests/bench/build_run.h"
#include "tests/support/built_splats.h"
#include "tests/support/mesh_reader.h"
#include "tests/support/node_spread.h"

namespace {

using bench::median;
using bench::must;
using bench::seconds;
using lod::qsplat::Header;
using support::Mesh;

Header headerOf(const std::string& scene) {
  return must(lod::qsplat::SplatFile::open(scene + "/qsplat.lgq")).header();
}

void compareSpeed(const std::string& path, const Mesh& mesh, const std::string& scene, int runs,
                  const std::string& memory, double dice) {
  std::vector<std::string> more{"--qsplat-dice", std::to_string(dice)};
  if (!memory.empty()) more.insert(more.end(), {"--memory", memory});
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
      "speed, disk to disk: %.2f M leaves/s and %.2f Mtri/s per core; meshopt_simplify to 10 %% in memory: %.2f "
      "Mtri/s; ratio %.2f (wanted 0.60)\n",
      1e-6 * leaves / median(ours), our_rate, their_rate, our_rate / their_rate);
  std::printf("two cores %.2f times one (wanted 1.7); peak memory %.0f MB; medians of %d\n", median(one) / median(two),
              peak, runs);
}

// How evenly two threads share the work, whatever else the machine does: the CPU time of both over that of the one that
// also does what cannot be shared.
void compareThreads(const std::string& path, const std::string& file, int runs, double dice) {
  std::vector<double> shares;
  for (int run = 0; run < runs; ++run) {
    const double all = seconds(CLOCK_PROCESS_CPUTIME_ID);
    const double main_thread = seconds(CLOCK_THREAD_CPUTIME_ID);
    lod::qsplat::builder::BuildOptions options;
    options.limits.threads = 2;
    options.dice = dice;
    (void)must(lod::qsplat::builder::buildFromFiles({path}, options, file));
    shares.push_back((seconds(CLOCK_PROCESS_CPUTIME_ID) - all) / (seconds(CLOCK_THREAD_CPUTIME_ID) - main_thread));
  }
  std::printf("of two threads' CPU time the busier one has 1/%.2f (wanted 1/1.7)\n", median(shares));
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

void printSpread(const std::string& path) {
  const auto file = must(lod::qsplat::SplatFile::open(path));
  const auto blocks = must(lod::qsplat::openBlocks(file.bytes(), file.header()));
  const auto largest = support::SpreadReader(*blocks).run().largest();
  std::printf(
      "in median leaf radii: the largest leaf %.1f, the largest node above leaves %.1f, the largest node above n "
      "leaves %.1f √n\n",
      largest.leaf, largest.above_leaves, largest.any);
}

void compareSize(Mesh mesh, const std::string& file, double dice) {
  lod::qsplat::builder::BuildOptions options;
  options.dice = dice;
  if (!mesh.colors.empty()) printSize("with colours", must(support::buildSplats(mesh, options, file)).header);
  mesh.colors.clear();
  printSize("without colours", must(support::buildSplats(mesh, options, file)).header);
  printSpread(file);
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(argc, argv, "MESH [--runs N] [--only speed|size] [--memory BYTES] [--dice FACTOR]");
  const auto runs = static_cast<int>(arguments.number("--runs", 5U, 1U, 100U));
  const std::string only = arguments.text("--only", "");
  const std::string memory = arguments.text("--memory", "");
  const double dice = arguments.number("--dice", lod::qsplat::builder::kDefaultDice, 0.0, 1e6);
  arguments.finish();
  if (arguments.input().empty() || (!only.empty() && only != "speed" && only != "size")) arguments.wrong();
  const bench::WorkDirectory directory;
  const Mesh mesh = must(support::readMesh(arguments.input())).mesh;
  std::printf("%s: %zu vertices, %zu triangles\n", arguments.input().c_str(), mesh.positions.size(),
              mesh.triangleCount());
  if (only.empty() || only == "speed") compareSpeed(arguments.input(), mesh, directory / "scene", runs, memory, dice);
  if (only.empty() || only == "speed") compareThreads(arguments.input(), directory / "threads.lgq", runs, dice);
  if (only.empty() || only == "size") compareSize(mesh, directory / "size.lgq", dice);
  return 0;
}
