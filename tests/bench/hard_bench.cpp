// hard_bench [MESH] [--kinds NAMES] [--share N] [--folder DIR] [--runs N]
// Builds the hierarchy of meshes that are made to be hard (hard_meshes.h) at one N-th of their size (default 10), each
// beside MESH or a generated statue of 3 M triangles in the same run: triangles a second of one core, what each level
// keeps of the one below, two cores over one, and in the end the fastest over the slowest.
#include <sstream>

#include "lod/patch/format.h"
#include "lod/patch/traverse.h"
#include "tests/bench/build_run.h"
#include "tests/bench/hard_meshes.h"

namespace {

using bench::median;

struct Rates {
  double triangles_per_second = 0.0;
  double kept_least = 1.0;
  double kept_most = 0.0;
};

// Levels of so few triangles are of one group or two, of which nothing can be said.
constexpr std::uint64_t kFewTriangles = 20'000;

Rates measure(const std::string& name, const std::string& path, const std::string& scene, std::size_t runs) {
  std::vector<double> cpu, one, two;
  double peak = 0.0;
  for (std::size_t run = 0; run < runs; ++run) {
    const bench::Run single = bench::runBuild(LUMIGRID_PROGRAM, "patch", path, scene, 1, {});
    const bench::Run pair = bench::runBuild(LUMIGRID_PROGRAM, "patch", path, scene, 2, {});
    cpu.push_back(single.cpu), one.push_back(single.wall), two.push_back(pair.wall);
    peak = std::max({peak, single.peak_mb, pair.peak_mb});
  }
  const auto file = bench::must(lod::patch::PatchFile::open(scene + "/patch.lgp"));
  std::vector<std::uint64_t> levels;
  for (const lod::patch::Patch& patch : file.hierarchy().patches) {
    if (patch.level >= levels.size()) levels.resize(patch.level + 1, 0);
    levels[patch.level] += patch.triangles;
  }
  Rates rates{static_cast<double>(levels.at(0)) / median(cpu), 1.0, 0.0};
  std::string kept;
  for (std::size_t level = 1; level < levels.size(); ++level) {
    const double share = static_cast<double>(levels[level]) / static_cast<double>(levels[level - 1]);
    std::array<char, 16> text{};
    std::snprintf(text.data(), text.size(), " %.2f", share);
    kept += text.data();
    if (levels[level - 1] < kFewTriangles) continue;
    rates.kept_least = std::min(rates.kept_least, share), rates.kept_most = std::max(rates.kept_most, share);
  }
  std::printf(
      "%-12s %8.2f M triangles: %.3f Mtri/s per core, two cores %.2f times one, peak %.0f MB, %.2f bytes a triangle; "
      "levels keep%s\n",
      name.c_str(), 1e-6 * static_cast<double>(levels[0]), 1e-6 * rates.triangles_per_second, median(one) / median(two),
      peak, static_cast<double>(file.fileBytes()) / static_cast<double>(levels[0]), kept.c_str());
  std::fflush(stdout);
  return rates;
}

}  // namespace

int main(int count, char** arguments) {
  bench::Arguments given(count, arguments, "[MESH] [--kinds NAMES] [--share N] [--folder DIR] [--runs N]");
  std::istringstream kinds(given.text("--kinds", "leaves,needles,soup,shells,tubes,mixed"));
  const auto share = given.number<std::size_t>("--share", 10, 1, 1000);
  const std::string folder = given.text("--folder", std::filesystem::temp_directory_path().string());
  const auto runs = given.number<std::size_t>("--runs", 1, 1, 99);
  given.finish();
  const bench::WorkDirectory work(folder);

  std::vector<Rates> all;
  std::string usual = given.input();
  if (usual.empty()) {
    usual = work / "statue.ply";
    if (std::system((std::string(LUMIGRID_PROGRAM) + " sample --triangles 3M -o " + usual).c_str()) != 0)
      bench::stop("lumigrid sample failed");
  }
  all.push_back(measure(std::filesystem::path(usual).stem().string(), usual, work / "scene", runs));
  for (std::string kind; std::getline(kinds, kind, ',');) {
    std::size_t triangles = 0;
    for (const auto& [name, full] : bench::hardMeshes())
      if (name == kind) triangles = full / share;
    const std::string path = work / (kind + ".ply");
    bench::makeHardMesh(kind, triangles).writePly(path);
    all.push_back(measure(kind, path, work / "scene", runs));
    std::filesystem::remove(path);
  }
  const auto [slow, fast] = std::minmax_element(all.begin(), all.end(), [](const Rates& a, const Rates& b) {
    return a.triangles_per_second < b.triangles_per_second;
  });
  double least = 1.0;
  double most = 0.0;
  for (const Rates& rates : all) least = std::min(least, rates.kept_least), most = std::max(most, rates.kept_most);
  std::printf("fastest over slowest: %.2f (wanted 2); levels keep %.2f to %.2f (wanted 0.35 to 0.45)\n",
              fast->triangles_per_second / slow->triangles_per_second, least, most);
  return 0;
}
