// Measures the bytes of a stored face: of its JPEG (filler under the mask, Huffman tables of its own) beside plain
// JPEGs of the whole picture on black and on white, at the same PSNR on the model's pixels, and of its mask.
//
//   face_bench SCENE|MESH [--grid N] [--face PIXELS] [--quality Q] [--faces COUNT]
//
// The faces are the sample that `lumigrid build --tune` measures. "standard" is with the JPEG standard's Huffman
// tables. Bytes at the same PSNR are interpolated between the two qualities around it.
#include <turbojpeg.h>

#include <cmath>
#include <cstdio>
#include <functional>
#include <numeric>
#include <string>
#include <vector>

#include "base/egl/headless.h"
#include "base/jpeg/jpeg.h"
#include "base/parallel.h"
#include "base/picture_error.h"
#include "repository/faces/coverage.h"
#include "repository/faces/filler.h"
#include "server/bake/bake.h"
#include "server/bake/face_encoder.h"
#include "server/bake/face_sample.h"
#include "tests/bench/bench_scene.h"

namespace {

using bench::must;
using bench::stop;

struct Arguments {
  bench::FaceArguments faces;
  std::uint32_t quality = 85;
  std::uint32_t count = 64;
};

Arguments parse(int argc, char** argv) {
  bench::Arguments given(argc, argv, std::string(bench::kFaceUsage) + " [--quality 2..99] [--faces COUNT]");
  Arguments a{bench::faceArguments(given, 12), given.number("--quality", 85U, 2U, 99U),
              given.number("--faces", 64U, 1U, 100000U)};
  given.finish();
  return a;
}

struct Face {
  base::Image rgba, mask, filled, black, white;
};

base::Image onBackground(const base::Image& rgba, const base::Image& mask, std::uint8_t level) {
  base::Image rgb(rgba.width, rgba.height, 3);
  for (std::size_t i = 0; i < rgb.pixels.size(); ++i)
    rgb.pixels[i] = mask.pixels[i / 3] != 0 ? rgba.pixels[4 * (i / 3) + i % 3] : level;
  return rgb;
}

std::vector<Face> sample(const Arguments& a) {
  const bench::WorkDirectory work;
  const auto [scene, patches] = bench::openScene(a.faces.input, work);
  const auto context = must(base::HeadlessContext::create());
  const auto renderer = must(server::SceneRenderer::create(scene, patches));
  const repository::Grid grid = repository::makeGrid(scene.localBox(), a.faces.grid, 0.5F, a.faces.face);
  auto pictures = must(server::sampleFaces(*renderer, grid, server::renderOptions({}), a.count));
  if (pictures.empty()) stop("no face shows the model");
  std::vector<Face> faces(pictures.size());
  for (std::size_t i = 0; i < faces.size(); ++i) {
    Face& face = faces[i];
    face.rgba = std::move(pictures[i]);
    face.mask = server::coverageMask(face.rgba);
    face.filled = repository::fillBackground(face.rgba, face.mask);
    face.black = onBackground(face.rgba, face.mask, 0);
    face.white = onBackground(face.rgba, face.mask, 255);
  }
  return faces;
}

base::Bytes withStandardTables(const base::Image& rgb, int quality) {
  void* handle = tjInitCompress();
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  if (tjCompress2(handle, rgb.pixels.data(), rgb.width, 0, rgb.height, TJPF_RGB, &bytes, &size, TJSAMP_420, quality,
                  TJFLAG_ACCURATEDCT) != 0)
    stop(tjGetErrorStr2(handle));
  base::Bytes all(bytes, bytes + size);
  tjFree(bytes);
  tjDestroy(handle);
  return all;
}

base::Bytes withOwnTables(const base::Image& rgb, int quality) {
  return must(base::encodeJpeg(rgb, quality, base::Subsampling::k420));
}

using Encode = std::function<base::Bytes(const Face&, int quality)>;
struct Point {
  double bytes = 0.0;  // a face
  double psnr_db = 0.0;
};

Point measure(const std::vector<Face>& faces, const Encode& encode, int quality) {
  std::vector<double> bytes(faces.size());
  std::vector<base::PictureError> errors(faces.size());
  base::parallelFor(faces.size(), 0, [&](std::size_t f) {
    const base::Bytes jpeg = encode(faces[f], quality);
    bytes[f] = static_cast<double>(jpeg.size());
    errors[f] = base::modelError(faces[f].rgba, must(base::decodeJpeg(jpeg)));
  });
  base::PictureError all;
  for (const base::PictureError& error : errors) all.add(error);
  const double sum = std::accumulate(bytes.begin(), bytes.end(), 0.0);
  return {sum / static_cast<double>(faces.size()), all.psnr()};
}

// Geometric between the two qualities whose PSNR lie around the target; from `quality` on, up or down.
double bytesAt(const std::vector<Face>& faces, const Encode& encode, double psnr_db, int quality) {
  Point here = measure(faces, encode, quality);
  const int step = here.psnr_db < psnr_db ? 1 : -1;
  while (here.psnr_db != psnr_db && quality + step >= 1 && quality + step <= 100) {
    quality += step;
    const Point next = measure(faces, encode, quality);
    if ((next.psnr_db < psnr_db) != (step > 0)) {
      const double share = (psnr_db - here.psnr_db) / (next.psnr_db - here.psnr_db);
      return std::exp((1.0 - share) * std::log(here.bytes) + share * std::log(next.bytes));
    }
    here = next;
  }
  return here.bytes;
}

}  // namespace

int main(int argc, char** argv) {
  const Arguments a = parse(argc, argv);
  const std::vector<Face> faces = sample(a);
  double mask_bytes = 0.0;
  double model = 0.0;
  for (const Face& face : faces) {
    mask_bytes += static_cast<double>(repository::encodeCoverage(face.mask).size());
    for (const std::uint8_t pixel : face.mask.pixels) model += pixel != 0 ? 1.0 : 0.0;
  }
  const auto count = static_cast<double>(faces.size());
  const int quality = static_cast<int>(a.quality);

  const Encode stored = [](const Face& face, int q) { return withOwnTables(face.filled, q); };
  const Point ours = measure(faces, stored, quality);
  const double total = ours.bytes + mask_bytes / count;
  std::printf("%zu faces of %u pixels, %.1f %% model; stored at quality %d, 4:2:0: %.2f dB\n", faces.size(),
              a.faces.face, 100.0 * model / count / a.faces.face / a.faces.face, quality, ours.psnr_db);
  std::printf("stored           JPEG %7.0f + mask %4.0f = %7.0f bytes a face\n", ours.bytes, mask_bytes / count, total);

  const std::vector<std::pair<const char*, Encode>> others = {
      {"filler, standard", [](const Face& face, int q) { return withStandardTables(face.filled, q); }},
      {"black, standard", [](const Face& face, int q) { return withStandardTables(face.black, q); }},
      {"white, standard", [](const Face& face, int q) { return withStandardTables(face.white, q); }},
      {"black, own tables", [](const Face& face, int q) { return withOwnTables(face.black, q); }},
      {"white, own tables", [](const Face& face, int q) { return withOwnTables(face.white, q); }},
  };
  for (const auto& [name, encode] : others) {
    const double bytes = bytesAt(faces, encode, ours.psnr_db, quality);
    std::printf("%-17s JPEG %7.0f bytes a face; stored is %.2f of it\n", name, bytes, total / bytes);
  }
  return 0;
}
