// tile_bench SCENE|MESH [--grid N] [--depth D] [--faces N] [--chart FILE.svg]
// Codes tiles of images as JPEG with their masks and as WebP, at rising qualities: bytes a tile with all that is stored
// of it, PSNR of the pixels that show the model, and CPU time to code and to decode one. The tiles are up to eight of
// each face in the sample that `lumigrid build --tune` measures. In the end WebP's bytes over JPEG's at the PSNR of
// JPEG's default quality, 85, and of its own, 80.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "base/egl/headless.h"
#include "base/file.h"
#include "base/format_text.h"
#include "base/picture_error.h"
#include "compare/chart.h"
#include "repository/faces/face_image.h"
#include "repository/sampling/grid.h"
#include "server/bake/bake.h"
#include "server/bake/face_encoder.h"
#include "server/bake/face_sample.h"
#include "tests/bench/bench_scene.h"

namespace {

using bench::must;
using bench::stop;

constexpr std::size_t kTilesOfFace = 8;
constexpr int kSide = static_cast<int>(repository::kTileSide);

struct Codec {
  const char* name;
  int usual;  ///< the quality that builds take by default
  std::function<base::Bytes(const base::Image& rgba, int quality)> encode;
};

const std::vector<Codec>& codecs() {
  static const std::vector<Codec> all{
      {"JPEG", 85,
       [](const base::Image& rgba, int quality) {
         return must(server::encodeImage(rgba, quality, base::Subsampling::k420, 0, base::kCoverageThreshold)).value;
       }},
      {"WebP", 80,
       [](const base::Image& rgba, int quality) { return must(server::encodeWebpImage(rgba, quality, 0)).value; }}};
  return all;
}

struct Point {
  int quality = 0;
  double bytes = 0.0, psnr_db = 0.0;                  ///< a tile; of all pixels that show the model
  double encode_seconds = 0.0, decode_seconds = 0.0;  ///< of CPU, a tile
};

/// One thread, so that times are those of a core.
Point measure(const std::vector<base::Image>& tiles, const Codec& codec, int quality) {
  Point point{quality};
  base::PictureError error;
  for (const base::Image& tile : tiles) {
    const double begin = bench::seconds(CLOCK_THREAD_CPUTIME_ID);
    const base::Bytes value = codec.encode(tile, quality);
    const double coded = bench::seconds(CLOCK_THREAD_CPUTIME_ID);
    const repository::FacePixels pixels = must(repository::decodeFacePixels(value, kSide));
    point.decode_seconds += bench::seconds(CLOCK_THREAD_CPUTIME_ID) - coded;
    point.encode_seconds += coded - begin;
    point.bytes += static_cast<double>(value.size());
    if (!pixels.rgb.empty()) error.add(base::modelError(tile, pixels.rgb));
  }
  const auto count = static_cast<double>(tiles.size());
  return {quality, point.bytes / count, error.psnr(), point.encode_seconds / count, point.decode_seconds / count};
}

/// The codec's bytes at a PSNR, between its qualities; NaN beyond them.
double bytesAt(const std::vector<Point>& points, double psnr_db) {
  for (std::size_t i = 1; i < points.size(); ++i) {
    const Point &a = points[i - 1], &b = points[i];
    if (psnr_db < a.psnr_db || psnr_db > b.psnr_db) continue;
    const double share = (psnr_db - a.psnr_db) / std::max(b.psnr_db - a.psnr_db, 1e-9);
    return std::exp((1.0 - share) * std::log(a.bytes) + share * std::log(b.bytes));
  }
  return std::nan("");
}

std::vector<base::Image> sample(const std::string& input, std::uint32_t points, std::uint32_t depth,
                                std::uint32_t faces) {
  const bench::WorkDirectory work;
  const auto [scene, patches] = bench::openScene(input, work);
  const auto context = must(base::HeadlessContext::create());
  const auto renderer = must(server::SceneRenderer::create(scene, patches));
  repository::Grid grid = repository::makeGrid(scene.localBox(), points, 0.5F, repository::kTileCore << depth);
  grid.tile_depth = depth;
  auto tiles = must(server::sampleTiles(*renderer, grid, server::renderOptions({}), faces, kTilesOfFace));
  if (tiles.empty()) stop("no face shows the model");
  return tiles;
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments given(argc, argv, "SCENE|MESH [--grid N] [--depth D] [--faces N] [--chart FILE.svg]");
  const auto points = given.number("--grid", 12U, 2U, 1024U);
  const auto depth = given.number("--depth", 3U, 1U, 5U);
  const auto faces = given.number("--faces", 24U, 1U, 1000U);
  const std::string chart_file = given.text("--chart", "");
  given.finish();
  if (given.input().empty()) given.wrong();

  const std::string name = std::filesystem::path(given.input()).stem();
  const std::vector<base::Image> tiles = sample(given.input(), points, depth, faces);
  std::printf("%zu tiles of %d pixels a side, depth %u at most\n", tiles.size(), kSide, depth);
  std::printf("codec  quality  bytes a tile  PSNR, dB  encode, ms  decode, ms\n");
  compare::Chart chart{
      base::formatText("%s, tiles of %d pixels a side", name.c_str(), kSide), "bytes a tile", "PSNR, dB", true, {}};
  std::vector<std::vector<Point>> measured;
  std::vector<Point> usual;
  for (const Codec& codec : codecs()) {
    chart.series.push_back({codec.name, {}, true});
    std::vector<Point>& own = measured.emplace_back();
    for (const int quality : {40, 50, 60, 70, 75, 80, 85, 90, 95, 98}) {
      own.push_back(measure(tiles, codec, quality));
      const Point& p = own.back();
      std::printf("%-6s %7d %13.0f %9.2f %11.2f %11.2f\n", codec.name, quality, p.bytes, p.psnr_db,
                  1e3 * p.encode_seconds, 1e3 * p.decode_seconds);
      chart.series.back().points.emplace_back(p.bytes, p.psnr_db);
      if (quality == codec.usual) usual.push_back(p);
    }
  }
  std::printf("WebP over JPEG: %.2f of the bytes at %.2f dB (JPEG %d), %.2f at %.2f dB (WebP %d)\n",
              bytesAt(measured[1], usual[0].psnr_db) / usual[0].bytes, usual[0].psnr_db, usual[0].quality,
              usual[1].bytes / bytesAt(measured[0], usual[1].psnr_db), usual[1].psnr_db, usual[1].quality);
  if (!chart_file.empty()) must(base::writeFileAtomically(chart_file, base::viewOfText(compare::formatChart(chart))));
  return 0;
}
