// The cost to bake a texel that shows the model, and its bytes: tiles beside plain faces, in one run.
//
//   texel_bench MESH [--grid N] [--runs N] [--work DIRECTORY]
//
// Builds the mesh with patches alone, then with images of each kind; the rest is the images' time, medians of --runs.
// Texels count where the model covers at least half of them. Of tiles those count whose quarter of the picture no finer
// tile shows: what remains is what a view as fine as the tiles can use.
#include <array>
#include <cstdio>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "repository/faces/face_image.h"
#include "repository/faces/face_value.h"
#include "repository/store.h"
#include "tests/bench/build_run.h"

namespace {

struct Texels {
  std::uint64_t images = 0, bytes = 0, useful = 0;
};

// Counts the texels of an image that show the model, where no child shows them finer.
std::uint64_t usefulTexels(const base::Image& image, std::uint8_t children) {
  std::uint64_t count = 0;
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) {
      const int quarter = (2 * y >= image.height ? 2 : 0) + (2 * x >= image.width ? 1 : 0);
      const std::size_t at =
          4 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) + static_cast<std::size_t>(x));
      if ((children >> quarter & 1U) == 0 && image.pixels[at + 3] >= 128) ++count;
    }
  return count;
}

Texels texelsOf(const std::string& scene) {
  const auto store = bench::must(repository::openLmdbStore(scene + "/images", repository::StoreMode::kRead));
  Texels sum;
  bench::must(store->forEach([&](const repository::FaceKey&, base::ByteView value) {
    const repository::FaceValue face = bench::must(repository::decodeFaceValue(value));
    sum.bytes += value.size();
    if (face.empty) return true;
    ++sum.images;
    sum.useful += usefulTexels(bench::must(repository::decodeFaceImage(value, 0)), face.children);
    return true;
  }));
  return sum;
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments given(argc, argv, "MESH [--grid N] [--runs N] [--work DIRECTORY]");
  const std::string grid = std::to_string(given.number("--grid", 6U, 2U, 64U));
  const auto runs = given.number("--runs", 3U, 1U, 100U);
  const std::string scene = given.text("--work", std::filesystem::temp_directory_path().string()) + "/texel_bench";
  given.finish();
  if (given.input().empty()) given.wrong();

  const int threads = static_cast<int>(std::max(1L, ::sysconf(_SC_NPROCESSORS_ONLN)));
  const auto build = [&](const std::string& methods, const std::vector<std::string>& more) {
    return bench::runBuild(LUMIGRID_PROGRAM, methods, given.input(), scene, threads, more);
  };
  using Words = std::vector<std::string>;
  const std::array<std::pair<const char*, Words>, 4> kinds{{{"faces of 512", {"--face", "512"}},
                                                            {"tiles to 496", {"--tiles", "1"}},
                                                            {"tiles to 992", {"--tiles", "2"}},
                                                            {"tiles to 1984", {"--tiles", "3"}}}};
  std::array<std::vector<double>, 4> cpu, wall;
  std::array<Texels, 4> texels;
  for (unsigned run = 0; run < runs; ++run) {
    const bench::Run patches = build("patch", {});
    for (std::size_t k = 0; k < kinds.size(); ++k) {
      Words words{"--grid", grid};
      words.insert(words.end(), kinds[k].second.begin(), kinds[k].second.end());
      const bench::Run all = build("patch,images", words);
      cpu[k].push_back(all.cpu - patches.cpu);
      wall[k].push_back(all.wall - patches.wall);
      texels[k] = texelsOf(scene);
    }
  }
  std::filesystem::remove_all(scene);
  const auto nanoseconds = [&](std::size_t k, const std::vector<double>& time) {
    return 1e9 * bench::median(time) / static_cast<double>(texels[k].useful);
  };
  for (std::size_t k = 0; k < kinds.size(); ++k)
    std::printf(
        "%-14s %6llu images %7.1f MB %8.1f M useful texels  CPU %6.1f s, %6.1f ns a texel, %.2f of faces'  "
        "wall %.2f of faces'  %.2f bits a texel\n",
        kinds[k].first, static_cast<unsigned long long>(texels[k].images), 1e-6 * static_cast<double>(texels[k].bytes),
        1e-6 * static_cast<double>(texels[k].useful), bench::median(cpu[k]), nanoseconds(k, cpu[k]),
        nanoseconds(k, cpu[k]) / nanoseconds(0, cpu[0]), nanoseconds(k, wall[k]) / nanoseconds(0, wall[0]),
        8.0 * static_cast<double>(texels[k].bytes) / static_cast<double>(texels[k].useful));
}
