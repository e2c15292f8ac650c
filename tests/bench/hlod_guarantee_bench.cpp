// hlod_guarantee_bench SCENE --shape SCENE2 [--views N] [--first N] [--seed S] [--side PIXELS] [--csv FILE]
//                      [--pictures DIR]
// The promise of HLOD (Guthe et al. 2004, section 3.1) at random views: the share of the places of a picture, 4 x 4 a
// pixel, that find their colour in the full mesh's picture within half a pixel, and how far sampled points of what is
// drawn are from the mesh, and points of the mesh from what is drawn, in pixels. SCENE has patches and nodes; SCENE2
// has nodes of the same mesh built with --appearance none. Those are drawn at the same tolerance, and again with as
// many triangles and points as SCENE draws (figure 6). Views that keep the least are left in DIR.
#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <random>

#include "base/file.h"
#include "base/format_text.h"
#include "base/parallel.h"
#include "base/png/png.h"
#include "server/render/scene_renderer.h"
#include "tests/bench/hlod_scenes.h"
#include "tests/compare/found_colors.h"
#include "tests/support/random_views.h"

namespace {

using bench::must;

// The picture is looked at in kPlaces along each side of a pixel, the truth in more, since its triangles are smaller:
// each drawn one by one without a filter.
constexpr int kPlaces = 4;
constexpr int kTruthPlaces = 16;
constexpr int kNoise = 8;              // 0 … 255, as in the test HlodGuarantee
constexpr float kTolerance = 0.5F;     // pixels
constexpr std::size_t kPoints = 1000;  // sampled of a view and direction
constexpr std::size_t kWorst = 3;      // views whose pictures are kept

constexpr support::ColorSearch kBetween{kTruthPlaces / 2, kNoise}, kInOnePixel{kTruthPlaces / 2, kNoise, true};

enum Kind : std::size_t { kAppearance, kShape, kShapeAsMany, kKinds };
constexpr std::array kNames{"appearance", "shape alone", "shape alone, as many"};

struct Distances {
  std::vector<double> px;
  void add(const Distances& other) { px.insert(px.end(), other.px.begin(), other.px.end()); }
  double shareWithin(double limit) const {
    const auto within = std::count_if(px.begin(), px.end(), [&](double d) { return d <= limit; });
    return px.empty() ? 1.0 : static_cast<double>(within) / static_cast<double>(px.size());
  }
  double max() const { return px.empty() ? 0.0 : *std::max_element(px.begin(), px.end()); }
};

/// A way to draw, at one view or over all of them.
struct Figures {
  support::FoundColors colors, in_one_pixel;
  std::uint64_t primitives = 0;
  Distances from_picture, from_mesh;
  void add(const Figures& other) {
    colors.add(other.colors), in_one_pixel.add(other.in_one_pixel);
    primitives += other.primitives;
    from_picture.add(other.from_picture);
    from_mesh.add(other.from_mesh);
  }
};
using ViewFigures = std::array<Figures, kKinds>;

/// Distances in pixels of points from a surface, at their own distance from the eye.
Distances measureDistances(const std::vector<glm::dvec3>& points, const support::NearestSurface& surface,
                           const base::Camera& camera) {
  Distances distances;
  distances.px.resize(points.size());
  base::parallelFor(points.size(), 0, [&](std::size_t i) {
    const glm::vec3 place(points[i]);
    distances.px[i] = static_cast<double>(
        lod::hlod::projectedError(camera, {place, place}, static_cast<float>(surface.distance(place))));
  });
  return distances;
}

bool isInPicture(const base::Camera& camera, const glm::dvec3& point) {
  constexpr float kMargin = 2.0F;  // pixels; nodes that lie outside are not drawn
  const glm::vec4 clip = camera.clipFromScene() * glm::vec4(glm::vec3(point), 1.0F);
  const glm::vec2 most(1.0F - 2.0F * kMargin / static_cast<float>(camera.width),
                       1.0F - 2.0F * kMargin / static_cast<float>(camera.height));
  return clip.w > 0.0F && std::abs(clip.x) <= most.x * clip.w && std::abs(clip.y) <= most.y * clip.w;
}

/// Up to kPoints random points that the picture shows, by area, hidden ones too.
std::vector<glm::dvec3> pointsInPicture(const support::Surface& surface, const base::Camera& camera,
                                        std::uint32_t seed) {
  std::vector<glm::dvec3> points;
  if (surface.triangles() == 0) return points;
  support::SurfacePoints random(surface, seed);
  for (std::size_t tries = 0; tries < 200 * kPoints && points.size() < kPoints; ++tries)
    if (const glm::dvec3 point = random.next(); isInPicture(camera, point)) points.push_back(point);
  return points;
}

class Views {
 public:
  Views(const std::string& directory, const std::string& shape_directory)
      : context_(must(base::HeadlessContext::create())),
        scene_(must(base::readScene(directory))),
        patches_(must(lod::patch::PatchFile::open(directory + "/patch.lgp"))),
        truth_(must(server::SceneRenderer::create(scene_, patches_))),
        renderers_{must(server::HlodScene::create(directory, scene_)),
                   must(server::HlodScene::create(shape_directory, bench::litAs(scene_, shape_directory)))},
        files_{bench::NodeFile(directory), bench::NodeFile(shape_directory)},
        mesh_(files_[0].surface({}, 1e-6F, false)),
        nearest_(mesh_) {}

  struct Pictures {
    base::Image truth;
    std::array<base::Image, kKinds> seen;
  };

  ViewFigures measure(const base::Camera& camera, std::uint32_t seed, Pictures& pictures) {
    base::Camera places = camera;
    places.width *= kPlaces, places.height *= kPlaces;
    base::Camera truth_places = camera;
    truth_places.width *= kTruthPlaces, truth_places.height *= kTruthPlaces;
    pictures.truth = must(truth_->render(truth_places, {.tolerance_px = 0.0F, .supersampling = 1})).rgba;
    ViewFigures figures;
    for (std::size_t kind = 0; kind < kKinds; ++kind) {
      const std::size_t file = kind == kAppearance ? 0 : 1;
      const float tolerance =
          kind == kShapeAsMany ? files_[1].toleranceFor(camera, figures[kAppearance].primitives) : kTolerance;
      // In a picture of more pixels a tolerance in pixels is as many times as large.
      server::HlodOptions options;
      options.supersampling = 1;
      options.tolerance = tolerance * kPlaces;
      pictures.seen[kind] = must(renderers_[file]->render(places, options)).rgba;
      figures[kind].primitives = files_[file].primitives(camera, tolerance);
      measureColors(pictures.seen[kind], pictures.truth, figures[kind]);
      if (kind != kShapeAsMany) measureShape(camera, files_[file].surface(camera, tolerance), seed, figures[kind]);
    }
    return figures;
  }

  const base::Sphere& bounds() const { return renderers_[0]->bounds(); }
  std::string renderer() const { return context_->renderer(); }

 private:
  static void measureColors(const base::Image& seen, const base::Image& truth, Figures& figures) {
    figures.colors = support::countFoundColors(seen, truth, kBetween);
    figures.in_one_pixel = support::countFoundColors(seen, truth, kInOnePixel);
  }
  void measureShape(const base::Camera& camera, const support::Surface& drawn, std::uint32_t seed, Figures& figures) {
    std::vector<glm::dvec3> points = pointsInPicture(drawn, camera, seed);
    // Points and corners have no area.
    std::mt19937 random(seed);
    for (std::size_t i = 0; i < kPoints && !drawn.indices.empty(); ++i)
      if (const glm::dvec3 corner(drawn.positions[drawn.indices[random() % drawn.indices.size()]]);
          isInPicture(camera, corner))
        points.push_back(corner);
    figures.from_picture = measureDistances(points, nearest_, camera);
    const support::NearestSurface nearest_drawn(drawn);
    figures.from_mesh = measureDistances(pointsInPicture(mesh_, camera, seed), nearest_drawn, camera);
  }

  const std::unique_ptr<base::HeadlessContext> context_;
  const base::Scene scene_;
  const lod::patch::PatchFile patches_;
  const std::unique_ptr<server::SceneRenderer> truth_;
  const std::array<std::unique_ptr<server::HlodScene>, 2> renderers_;
  std::array<bench::NodeFile, 2> files_;
  const support::Surface mesh_;  ///< the leaves
  const support::NearestSurface nearest_;
};

/// Red where a place does not find its colour, else the picture in grey.
base::Image lostPlaces(const base::Image& picture, const base::Image& truth) {
  base::Image out(picture.width, picture.height, 3);
  for (int y = 0; y < out.height; ++y)
    for (int x = 0; x < out.width; ++x) {
      const auto from = picture.at(x, y);
      const bool is_lost = from[3] >= 128 && !support::findsColor(picture, truth, x, y, kBetween);
      const auto grey = static_cast<std::uint8_t>(from[3] < 128 ? 255 : 128 + (from[0] + from[1] + from[2]) / 6);
      const base::Rgb color = is_lost ? base::Rgb{220, 0, 0} : base::Rgb{grey, grey, grey};
      std::copy_n(color.data(), 3, out.at(x, y));
    }
  return out;
}

void writePictures(const Views::Pictures& pictures, const std::string& stem) {
  must(base::writePng(pictures.truth, stem + "_truth.png"));
  for (std::size_t kind = 0; kind < kKinds; ++kind)
    must(base::writePng(pictures.seen[kind], base::formatText("%s_%zu.png", stem.c_str(), kind)));
  must(base::writePng(lostPlaces(pictures.seen[kAppearance], pictures.truth), stem + "_lost.png"));
}

void printFigures(const ViewFigures& sums, const std::vector<double>& shares) {
  std::printf(
      "drawn                 found, %%   in one pixel, %%  triangles + points a view   to the mesh: within half a "
      "pixel, %%  max px"
      "   from the mesh: %%  max px\n");
  for (std::size_t kind = 0; kind < kKinds; ++kind) {
    const Figures& sum = sums[kind];
    std::printf("%-20s  %8.3f  %8.3f  %10.0f", kNames[kind], 100.0 * sum.colors.share(),
                100.0 * sum.in_one_pixel.share(),
                static_cast<double>(sum.primitives) / static_cast<double>(shares.size()));
    if (kind != kShapeAsMany)
      std::printf("   %8.4f %7.3f   %8.4f %7.3f", 100.0 * sum.from_picture.shareWithin(0.5), sum.from_picture.max(),
                  100.0 * sum.from_mesh.shareWithin(0.5), sum.from_mesh.max());
    std::printf("\n");
  }
  const auto kept = std::count_if(shares.begin(), shares.end(), [](double share) { return share >= 0.995; });
  std::printf("%td of %zu views keep 99.5 %% of %llu places together; the least keeps %.3f %%\n", kept, shares.size(),
              static_cast<unsigned long long>(sums[kAppearance].colors.places),
              100.0 * *std::min_element(shares.begin(), shares.end()));
}

struct Options {
  unsigned views = 0, first = 0, seed = 0;
  int side = 0;
  std::string csv, pictures;
};

constexpr const char* kCsvHeader =
    "view,places,found,in_one_pixel,primitives,shape_places,shape_found,shape_in_one_pixel,shape_primitives,"
    "as_many_places,as_many_found,as_many_in_one_pixel,as_many_primitives,to_mesh_px,from_mesh_px\n";

std::string csvLine(unsigned view, const ViewFigures& figures) {
  std::string line = std::to_string(view);
  for (const Figures& kind : figures)
    for (const std::uint64_t count : {kind.colors.places, kind.colors.found, kind.in_one_pixel.found, kind.primitives})
      line += "," + std::to_string(count);
  return line + base::formatText(",%.4f,%.4f\n", figures[kAppearance].from_picture.max(),
                                 figures[kAppearance].from_mesh.max());
}

void run(Views& views, const Options& options) {
  support::RandomViews random(options.seed, views.bounds(), options.side);
  std::string csv = kCsvHeader;
  ViewFigures sums;
  std::vector<double> shares, worst;
  for (unsigned view = 0; view < options.first + options.views; ++view) {
    const base::Camera camera = random.next();
    if (view < options.first) continue;
    Views::Pictures pictures;
    const ViewFigures figures = views.measure(camera, view, pictures);
    for (std::size_t kind = 0; kind < kKinds; ++kind) sums[kind].add(figures[kind]);
    shares.push_back(figures[kAppearance].colors.share());
    csv += csvLine(view, figures);
    std::sort(worst.begin(), worst.end());
    if (options.pictures.empty() || (worst.size() >= kWorst && shares.back() >= worst[kWorst - 1])) continue;
    worst.push_back(shares.back());
    writePictures(pictures, base::formatText("%s/view_%03u", options.pictures.c_str(), view));
    std::printf("view %u keeps %.3f %%\n", view, 100.0 * shares.back());
    std::fflush(stdout);
  }
  printFigures(sums, shares);
  if (!options.csv.empty()) must(base::writeFileAtomically(options.csv, base::viewOfText(csv)));
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(argc, argv,
                             "SCENE --shape SCENE2 [--views N] [--first N] [--seed S] [--side PIXELS] [--csv FILE] "
                             "[--pictures DIR]");
  Options options;
  options.views = arguments.number("--views", 100U, 1U, 100'000U);
  options.first = arguments.number("--first", 0U, 0U, 100'000U);
  options.seed = arguments.number("--seed", 5U, 0U, 1U << 30U);
  options.side = static_cast<int>(arguments.number("--side", 240U, 16U, 1024U));
  options.csv = arguments.text("--csv", "");
  options.pictures = arguments.text("--pictures", "");
  const std::string shape = arguments.text("--shape", "");
  arguments.finish();
  if (arguments.input().empty() || shape.empty()) arguments.wrong();
  if (!options.pictures.empty()) std::filesystem::create_directories(options.pictures);
  Views views(arguments.input(), shape);
  std::printf("%s, %s; %u views from number %u on, %d x %d pixels\n", arguments.input().c_str(),
              views.renderer().c_str(), options.views, options.first, options.side, options.side);
  run(views, options);
  return 0;
}
