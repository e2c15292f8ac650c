// Measures `lumigrid build` of a scan with JPEG textures against decoding its pictures once on the same cores, in one
// run, and its pages against the pictures' bytes. Both have read the pictures before.
//
//   texture_bench MESH.obj [--threads N] [--memory MIB] [--rounds N] [--work DIRECTORY]
//
// All JPEGs beside the mesh count as its pictures. Builds and decodings alternate; the medians are compared.
#include <atomic>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "base/file.h"
#include "base/jpeg/jpeg.h"
#include "base/parallel.h"
#include "tests/bench/bench.h"
#include "tests/bench/build_run.h"

namespace {

struct Pictures {
  std::vector<std::string> paths;
  std::uint64_t bytes = 0;
};

Pictures picturesBeside(const std::string& mesh) {
  Pictures found;
  const std::filesystem::path folder = std::filesystem::absolute(mesh).parent_path();
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    if (entry.path().extension() == ".jpg") {
      found.paths.push_back(entry.path().string());
      found.bytes += entry.file_size();
    }
  if (found.paths.empty()) bench::stop("no .jpg beside " + mesh);
  std::sort(found.paths.begin(), found.paths.end());
  return found;
}

struct Decoding {
  double wall = 0.0, cpu = 0.0;
  std::uint64_t texels = 0;
};

Decoding decodeOnce(const Pictures& pictures, unsigned threads) {
  const double start = bench::seconds(), start_cpu = bench::seconds(CLOCK_PROCESS_CPUTIME_ID);
  std::atomic<std::uint64_t> texels = 0;
  bench::must(base::tryParallelFor(pictures.paths.size(), threads, [&](std::size_t i) -> base::Result<void> {
    LUMIGRID_ASSIGN_OR_RETURN(const auto file, base::MappedFile::open(pictures.paths[i]));
    LUMIGRID_ASSIGN_OR_RETURN(const auto image, base::decodeJpeg(file.bytes()));
    texels += image.pixels.size() / 3;
    return {};
  }));
  return {bench::seconds() - start, bench::seconds(CLOCK_PROCESS_CPUTIME_ID) - start_cpu, texels};
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments given(argc, argv, "MESH.obj [--threads N] [--memory MIB] [--rounds N] [--work DIRECTORY]");
  const auto threads = given.number("--threads", base::coreCount(), 1U, 1024U);
  const auto memory = given.number("--memory", 1024U, 64U, 1U << 20);
  const auto rounds = given.number("--rounds", 3U, 1U, 100U);
  const std::string work = given.text("--work", std::filesystem::temp_directory_path().string());
  given.finish();
  if (given.input().empty()) given.wrong();
  const Pictures pictures = picturesBeside(given.input());
  const bench::WorkDirectory directory(work);
  const std::string scene = directory / "scene";

  decodeOnce(pictures, threads);  // brings them to memory
  std::vector<double> decoding, building;
  for (unsigned round = 0; round < rounds; ++round) {
    const Decoding decoded = decodeOnce(pictures, threads);
    const bench::Run built = bench::runBuild(LUMIGRID_PROGRAM, "patch", given.input(), scene, static_cast<int>(threads),
                                             {"--memory", std::to_string(memory) + "MiB"});
    decoding.push_back(decoded.wall), building.push_back(built.wall);
    std::printf("decoding once: %.2f s, %.2f s of cores, %.0f million texels\n", decoded.wall, decoded.cpu,
                static_cast<double>(decoded.texels) / 1e6);
    std::printf("building: %.2f s, %.2f s of cores, %.0f MB at most\n", built.wall, built.cpu, built.peak_mb);
  }
  const auto pages = static_cast<double>(std::filesystem::file_size(scene + "/texture.lgt"));
  std::printf("%zu pictures on %u threads: building takes %.2f times as long as decoding once (wanted: 2)\n",
              pictures.paths.size(), threads, bench::median(building) / bench::median(decoding));
  std::printf("pages: %.1f MB, %.2f times the pictures' %.1f MB\n", pages / 1e6,
              pages / static_cast<double>(pictures.bytes), static_cast<double>(pictures.bytes) / 1e6);
  return 0;
}
