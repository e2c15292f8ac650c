// Nodes a second of a traversal: splat_bench [MESH | qsplat.lgq] [--size 1280] [--threads N]. Without a file a
// generated sphere of a million vertices is taken.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <vector>

#include "base/parallel.h"
#include "lod/build/import.h"
#include "lod/qsplat/splat_file.h"
#include "lod/qsplat/traverse.h"
#include "tests/bench/bench.h"
#include "tests/support/splat_tree.h"
#include "tests/support/test_meshes.h"

namespace {
using namespace lod::qsplat;

base::Camera cameraOf(const base::Sphere& root, double turn, double distance, int size) {
  base::ViewCamera view;
  const glm::dvec3 away(std::cos(turn), std::sin(turn), 0.3);
  view.position = glm::dvec3(root.center) + distance * static_cast<double>(root.radius) * glm::normalize(away);
  view.direction = -glm::normalize(away);
  view.up = {0, 0, 1};
  view.width = size;
  view.height = size * 9 / 16;
  return base::cameraForScene(view, glm::dvec3(0.0), root);
}
}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(argc, argv, "[qsplat.lgq] [--size PIXELS]");
  const int size = static_cast<int>(arguments.number<unsigned>("--size", 1280U, 16U, 8192U));
  arguments.finish();
  base::Bytes made;
  std::optional<SplatFile> opened;
  if (arguments.input().empty())
    made = support::splatFile(support::bumpySphere(700, 1400));
  else
    opened.emplace(bench::must(SplatFile::open(arguments.input())));
  const base::ByteView bytes = opened ? opened->bytes() : base::ByteView(made);
  const Header header = bench::must(readHeader(bytes));
  if (!opened)
    for (const std::string& fault : checkTree(bytes)) std::printf("fault: %s\n", fault.c_str());
  MappedBlocks blocks(bytes, header);
  std::printf("%llu nodes, %.1f MB\n", static_cast<unsigned long long>(header.nodes),
              1e-6 * static_cast<double>(bytes.size()));
  for (const double distance : {1.2, 2.5, 10.0})
    for (const float cutoff : {0.0F, 1.0F, 4.0F}) {
      std::vector<double> rates, parallel;
      Traversal result;
      for (int i = 0; i < 9; ++i) {
        TraverseRequest request;
        request.camera = cameraOf(header.root, 0.7 * i, distance, size);
        request.cutoff_px = cutoff;
        double start = bench::seconds(CLOCK_THREAD_CPUTIME_ID);
        result = traverse(blocks, request);
        rates.push_back(static_cast<double>(result.nodes) / (bench::seconds(CLOCK_THREAD_CPUTIME_ID) - start));
        request.for_each = [](std::size_t n, const std::function<void(std::size_t)>& body) {
          base::parallelFor(n, 0, body);
        };
        start = bench::seconds();
        result = traverse(blocks, request);
        parallel.push_back(static_cast<double>(result.nodes) / (bench::seconds() - start));
      }
      std::printf("distance %4.1f cut-off %3.1f px: %9llu nodes %9zu splats  %6.1f M nodes/s a core, %6.1f on all\n",
                  distance, static_cast<double>(cutoff), static_cast<unsigned long long>(result.nodes),
                  result.splats.size(), 1e-6 * bench::median(rates), 1e-6 * bench::median(parallel));
    }
  return 0;
}
