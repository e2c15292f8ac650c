// Client frames: 4, 8 and 16 images beside plain shaded drawing of the same proxy, in the same run. Medians of several
// frames. Run by hand: frame_bench [triangles] [frames]
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "base/egl/headless.h"
#include "base/gl/gl.h"
#include "client/render/lumigraph.h"
#include "tests/bench/bench.h"

namespace {

constexpr int kFace = 512;

/// Returns a bumpy sphere of radius 1 in bands of at most 4 000 triangles.
std::vector<lod::patch::PatchGeometry> makeProxy(int triangles, const lod::Lattice& lattice) {
  const int rings = static_cast<int>(std::sqrt(static_cast<double>(triangles) / 4.0));
  const int columns = 2 * rings;
  const int band = std::max(1, 2000 / columns);
  std::vector<lod::patch::PatchGeometry> patches;
  for (int first = 0; first < rings; first += band) {
    lod::patch::PatchGeometry patch;
    const int count = std::min(band, rings - first);
    for (int j = first; j <= first + count; ++j)
      for (int i = 0; i <= columns; ++i) {
        const double theta = 3.14159265358979 * j / rings;
        const double phi = 6.28318530717959 * (i % columns) / columns;
        const glm::dvec3 n(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), -std::cos(theta));
        const double radius = 1.0 + 0.02 * std::sin(20.0 * theta) * std::sin(20.0 * phi);
        patch.positions.push_back(glm::ivec3((radius * n - lattice.origin) / lattice.step));
        patch.normals.push_back(glm::vec3(n));
        patch.colors.push_back(glm::u8vec4(glm::vec3(127.0F) + 100.0F * glm::vec3(n), 255));
      }
    for (int j = 0; j < count; ++j)
      for (int i = 0; i < columns; ++i) {
        const auto at = [&](int x, int y) { return static_cast<std::uint16_t>(y * (columns + 1) + x); };
        for (const std::uint16_t v :
             {at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j), at(i + 1, j + 1), at(i, j + 1)})
          patch.indices.push_back(v);
      }
    patches.push_back(std::move(patch));
  }
  return patches;
}

base::Camera lookAtCenter(const glm::dvec3& eye, int width, int height, double fov_y) {
  base::ViewCamera view;
  view.position = eye;
  view.direction = glm::normalize(-eye);
  view.up = glm::dvec3(0, 0, 1);
  view.fov_y = fov_y;
  view.width = width;
  view.height = height;
  return base::cameraFromView(view, glm::dvec3(0.0), 0.1F, 10.0F);
}

base::Image pictureOfNothingInParticular() {
  base::Image image(kFace, kFace, 4);
  for (std::size_t i = 0; i < image.pixels.size(); ++i)
    image.pixels[i] = i % 4 == 3 ? 255 : static_cast<std::uint8_t>(i * 2654435761U >> 13);
  return image;
}

double medianMilliseconds(client::LumigraphRenderer& renderer, const base::Camera& camera,
                          const std::vector<std::uint32_t>& cut, const client::LumigraphOptions& options, int frames) {
  auto target = base::gl::RenderTarget::create(camera.width, camera.height);
  if (!target) return 0.0;
  target->bind();
  std::vector<double> times;
  for (int i = 0; i <= frames; ++i) {
    const double start = bench::seconds();
    renderer.draw(camera, cut, {}, 1.0F, {}, options, 0.0);
    glFinish();
    if (i > 0) times.push_back(1e3 * (bench::seconds() - start));
  }
  return bench::median(times);
}

}  // namespace

int main(int argc, char** argv) {
  const int triangles = argc > 1 ? std::atoi(argv[1]) : 100000;
  const int frames = argc > 2 ? std::atoi(argv[2]) : 9;
  auto context = base::HeadlessContext::create();
  if (!context) return std::fprintf(stderr, "%s\n", context.error().message.c_str()), 1;
  const lod::Lattice lattice{glm::dvec3(-2.0), 1.0 / 65536.0};
  auto renderer = client::LumigraphRenderer::create(lattice, kFace, std::uint64_t{1} << 30);
  if (!renderer) return std::fprintf(stderr, "%s\n", renderer.error().message.c_str()), 1;

  std::vector<std::uint32_t> cut;
  for (const auto& patch : makeProxy(std::max(triangles, 1000), lattice)) {
    (*renderer)->patches().upload(static_cast<std::uint32_t>(cut.size()), patch);
    cut.push_back(static_cast<std::uint32_t>(cut.size()));
  }
  const base::Image picture = pictureOfNothingInParticular();
  for (int i = 0; i < 16; ++i)
    (*renderer)->addSample(static_cast<client::SampleId>(i),
                           lookAtCenter({-0.75 + 0.1 * i, -3.0, 0.3 - 0.04 * i}, kFace, kFace, 0.9), picture, 0.0);

  std::printf("%s\n%zu patches; milliseconds a frame (median of %d) and ratio to plain shading\n",
              (*context)->renderer().c_str(), cut.size(), frames);
  std::printf("%-12s %10s %16s %16s %16s\n", "size", "shaded", "4 images", "8 images", "16 images");
  for (const auto& [width, height] : {std::pair{640, 360}, std::pair{1280, 720}}) {
    const base::Camera camera = lookAtCenter({0.1, -2.6, 0.1}, width, height, 0.8);
    client::LumigraphOptions options;
    options.fade_seconds = 0.0F;
    options.use_images = false;
    const double plain = medianMilliseconds(**renderer, camera, cut, options, frames);
    options.use_images = true;
    std::string row;
    for (const int samples : {4, 8, 16}) {
      options.max_samples = samples;
      const double time = medianMilliseconds(**renderer, camera, cut, options, frames);
      char cell[64];
      std::snprintf(cell, sizeof(cell), " %8.1f (%4.1fx)", time, time / plain);
      row += cell;
    }
    std::printf("%4d x %-5d %10.1f %s\n", width, height, plain, row.c_str());
  }
}
