// Measures drawing and encoding of faces with the pages of their textures beside the colours of their vertices, and how
// near the former are to the truth.
//
//   page_bench SCENE [--grid N] [--tiles DEPTH] [--points COUNT] [--rounds N] [--judged FACES] [--truths DIRECTORY]
//
// All six faces of points that are spread over the grid are drawn as `lumigrid build` draws them, with and without in
// turns. Figures are CPU time of the whole process, medians of the rounds; the first of each, which uploads, is told
// apart. The truth has 8 x 8 samples a pixel; --truths keeps it for later runs.
#include <array>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "base/egl/headless.h"
#include "base/format_text.h"
#include "base/picture_error.h"
#include "base/png/png.h"
#include "server/bake/bake.h"
#include "server/bake/face_encoder.h"
#include "server/bake/face_sample.h"
#include "tests/bench/bench_scene.h"

namespace {

using bench::must;

struct Arguments {
  std::string scene, truths;
  std::uint32_t grid = 5, depth = 3, points = 8, rounds = 3, judged = 6;
};

Arguments parse(int argc, char** argv) {
  bench::Arguments given(argc, argv,
                         "SCENE [--grid 2..64] [--tiles 1..5] [--points COUNT] [--rounds N] [--judged FACES] "
                         "[--truths DIRECTORY]");
  Arguments a;
  a.scene = given.input();
  if (a.scene.empty()) given.wrong();
  a.truths = given.text("--truths", "");
  a.grid = given.number("--grid", a.grid, 2U, 64U);
  a.depth = given.number("--tiles", a.depth, 1U, 5U);
  a.points = given.number("--points", a.points, 1U, 10000U);
  a.rounds = given.number("--rounds", a.rounds, 1U, 100U);
  a.judged = given.number("--judged", a.judged, 0U, 10000U);
  given.finish();
  return a;
}

double cpuSeconds() {
  return bench::seconds(CLOCK_PROCESS_CPUTIME_ID);
}

using Point = std::vector<repository::FaceKey>;

std::vector<Point> spreadPoints(const repository::Grid& grid, std::size_t count) {
  const auto all = repository::pointsInMortonOrder(grid);
  count = std::min(count, all.size());
  std::vector<Point> points(count);
  for (std::size_t i = 0; i < count; ++i)
    for (std::uint32_t d = 0; d < 6; ++d) {
      const glm::uvec3& p = all[(2 * i + 1) * all.size() / (2 * count)];
      points[i].push_back({p.x, p.y, p.z, d});
    }
  return points;
}

/// Draws with a context that is current, and measures.
class Drawing {
 public:
  Drawing(const base::Scene& scene, const lod::patch::PatchFile& patches, const server::BakeOptions& options)
      : options_(options), renderer_(must(server::SceneRenderer::create(scene, patches))) {}

  /// Returns the faces that show something.
  std::vector<base::Image> draw(const std::vector<Point>& points) {
    std::vector<base::Image> seen;
    const double start = cpuSeconds();
    for (const Point& point : points)
      must(renderer_->renderMany(server::faceCameras(*renderer_, options_.grid, point), server::renderOptions(options_),
                                 [&](std::size_t, server::RenderedPicture rendered) {
                                   if (server::showsModel(rendered.rgba)) seen.push_back(std::move(rendered.rgba));
                                 }));
    must(renderer_->finish());
    (first < 0.0 ? first : times.emplace_back()) = cpuSeconds() - start;
    faces = 6 * points.size();
    return seen;
  }

  void encode(const std::vector<base::Image>& pictures) {
    const double start = cpuSeconds();
    for (const base::Image& picture : pictures)
      must(server::encodeFace(
          picture, {options_.quality, options_.subsampling, options_.grid.tile_depth, repository::ImageCodec::kWebp}));
    encodings.push_back(cpuSeconds() - start);
  }

  server::SceneRenderer& renderer() { return *renderer_; }

  double first = -1.0;
  std::vector<double> times, encodings;
  std::size_t faces = 0;

 private:
  const server::BakeOptions& options_;
  std::unique_ptr<server::SceneRenderer> renderer_;
};

base::Image truthOf(const std::string& path, server::SceneRenderer& renderer, const base::Camera& camera,
                    server::RenderOptions options) {
  if (!path.empty() && std::filesystem::exists(path)) return must(base::readPng(path));
  options.supersampling = 8;
  auto truth = must(renderer.render(camera, options)).rgba;
  if (!path.empty()) must(base::writePng(truth, path));
  return truth;
}

}  // namespace

int main(int argc, char** argv) {
  const Arguments a = parse(argc, argv);
  const bench::WorkDirectory work;
  const bench::OpenScene open = bench::openScene(a.scene, work);
  if (!base::partFile(open.scene, "texture", ".lgt")) bench::stop(a.scene + ": a scene without textures");
  base::Scene plain = open.scene;
  std::erase_if(plain.parts, [](const auto& part) { return part.file.starts_with("texture"); });

  server::BakeOptions options;
  options.grid = repository::withTiles(repository::makeGrid(open.scene.localBox(), a.grid, 0.5F, 512), a.depth);
  const std::vector<Point> points = spreadPoints(options.grid, a.points);
  const auto context = must(base::HeadlessContext::create());
  std::array<Drawing, 2> drawings{Drawing(open.scene, open.patches, options), Drawing(plain, open.patches, options)};
  for (std::uint32_t round = 0; round <= a.rounds; ++round)
    for (Drawing& drawing : drawings) {
      const auto pictures = drawing.draw(points);
      if (round == 0) drawing.encode(pictures);
    }

  std::printf("GL: %s; %zu faces of %u pixels; ms of CPU time a face\n", context->renderer().c_str(), drawings[0].faces,
              server::drawnSide(options.grid));
  std::printf("%-10s %8s %8s %8s\n", "", "first", "drawing", "encoding");
  for (std::size_t k = 0; k < 2; ++k) {
    const double each = 1e3 / static_cast<double>(drawings[k].faces);
    std::printf("%-10s %8.2f %8.2f %8.2f\n", k == 0 ? "textures" : "colours", each * drawings[k].first,
                each * bench::median(drawings[k].times), each * bench::median(drawings[k].encodings));
  }

  base::PictureError all;
  std::uint32_t judged = 0;
  for (std::size_t i = 0; i < points.size() * 6 && judged < a.judged; ++i) {
    const repository::FaceKey key = points[i % points.size()][i / points.size()];
    server::SceneRenderer& renderer = drawings[0].renderer();
    const base::Camera camera = server::faceCameras(renderer, options.grid, {key}).front();
    const base::Image picture = must(renderer.render(camera, server::renderOptions(options))).rgba;
    if (!server::showsModel(picture)) continue;
    ++judged;
    const std::string path =
        a.truths.empty() ? ""
                         : base::formatText("%s/%s_%u.png", a.truths.c_str(), repository::nameOf(key).c_str(), a.grid);
    const auto error = base::foregroundError(truthOf(path, renderer, camera, server::renderOptions(options)), picture);
    std::printf("%s: %.2f dB\n", repository::nameOf(key).c_str(), error.psnr());
    all.add(error);
  }
  if (judged > 0) std::printf("all %u: %.3f dB\n", judged, all.psnr());
  return 0;
}
