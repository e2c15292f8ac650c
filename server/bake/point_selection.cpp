#include "server/bake/point_selection.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <tuple>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "base/egl/headless.h"
#include "base/file.h"
#include "base/parallel.h"
#include "base/view_defaults.h"
#include "lod/patch/proxy_sight.h"
#include "plan/point_choice.h"
#include "repository/sampling/parameters.h"
#include "server/bake/draw_memory.h"
#include "server/bake/enclosed.h"
#include "server/bake/face_encoder.h"
#include "server/bake/face_sample.h"
#include "server/render/scene_renderer.h"

namespace server {
namespace {

constexpr std::uint32_t kSeed = 20111;  // gives other views than the held-out ones of `lumigrid tour --random`
constexpr double kMaxDropShare = 0.25;  // so large a share of the points, the least used, is dropped at a time …
constexpr double kMinDropShare = 0.01;  // … and half as many where that is too many, down to this; choices

bool comesFirst(const glm::uvec3& a, const glm::uvec3& b) {
  return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z);
}
struct PointOrder {
  bool operator()(const glm::uvec3& a, const glm::uvec3& b) const { return comesFirst(a, b); }
};

/// The sum of what the choices for all views gain.
struct Worth {
  double sum = 0.0;
  std::map<glm::uvec3, double, PointOrder> of_points;  ///< worth of each point that some view chooses
};

/// A view's question for points, and the surface that the view shows.
struct ViewDemand {
  plan::PointQuery query;
  std::vector<plan::SurfaceSample> samples;
};

std::vector<ViewDemand> demandsOf(const base::Scene& scene, const repository::Grid& grid,
                                  const std::vector<base::ViewCamera>& views, const lod::patch::ProxySight& sight,
                                  unsigned threads) {
  const base::Sphere bounds{glm::vec3(0.5 * (scene.box_min + scene.box_max) - scene.origin),
                            0.5F * static_cast<float>(glm::length(scene.box_max - scene.box_min))};
  std::vector<ViewDemand> demands(views.size());
  base::parallelFor(views.size(), threads, [&](std::size_t i) {
    const base::Camera camera = base::cameraForScene(views[i], scene.origin, bounds);
    plan::PointQuery& query = demands[i].query;
    query.grid = grid;
    query.sight = &sight;
    query.eye = camera.eye;
    query.pixels_per_unit_at_one = camera.pixelsPerUnitAtOne();
    query.error_px = base::ViewDefaults::kPatchTolerance;
    query.max_points = base::ViewDefaults::kPoints;
    demands[i].samples = plan::sampleVisibleSurface(sight, camera);
  });
  return demands;
}

/// The cells of `size` steps that have one of these points within or on a side, by their places among such cells.
std::unordered_set<std::uint64_t> cellsAround(const std::vector<glm::uvec3>& points, std::uint32_t size) {
  std::unordered_set<std::uint64_t> cells;
  for (const glm::uvec3& p : points)
    for (std::uint32_t i = 0; i < 8; ++i) {
      const glm::uvec3 below(std::min(p.x, i & 1), std::min(p.y, i >> 1 & 1), std::min(p.z, i >> 2));
      const glm::uvec3 cell = (p - below) / size;
      cells.insert(repository::codeOfPoint(cell));
    }
  return cells;
}

/// The largest power of two of grid steps that the grid's longest side holds.
std::uint32_t largestCell(const repository::Grid& grid) {
  const std::uint32_t steps = std::max({grid.count.x, grid.count.y, grid.count.z}) - 1;
  std::uint32_t size = 1;
  while (2 * size <= steps) size *= 2;
  return size;
}

/// Cells are split down to single steps around each of these points (sorted), so that whoever looks there finds it.
repository::SampleTree treeOf(const repository::Grid& grid, const std::vector<glm::uvec3>& points) {
  repository::SampleTree tree(grid, largestCell(grid));
  for (auto open = tree.openLeaves(); !open.empty(); open = tree.openLeaves()) {
    const std::uint32_t size = open.front().size;  // all have the same: each round splits or closes all
    const auto around = cellsAround(points, size);
    for (const repository::SampleTree::Cell& cell : open) {
      const glm::uvec3 at = cell.corner / size;
      around.count(repository::codeOfPoint(at)) != 0 ? tree.split(cell) : tree.close(cell);
    }
  }
  for (const glm::uvec3& p : tree.points())
    if (!std::binary_search(points.begin(), points.end(), p, comesFirst)) tree.leaveOut(p);
  return tree;
}

/// The points in order, but for the least used `share` of them.
std::vector<glm::uvec3> mostUsed(const Worth& worth, double share) {
  std::vector<std::pair<double, glm::uvec3>> ranked;
  for (const auto& [point, gain] : worth.of_points) ranked.emplace_back(gain, point);
  std::sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) {
    return a.first != b.first ? a.first > b.first : comesFirst(a.second, b.second);
  });
  const auto dropped = static_cast<std::size_t>(std::ceil(share * static_cast<double>(ranked.size())));
  std::vector<glm::uvec3> kept;
  for (std::size_t i = 0; i + dropped < ranked.size(); ++i) kept.push_back(ranked[i].second);
  std::sort(kept.begin(), kept.end(), comesFirst);
  return kept;
}

/// Points that an estimate draws at most: 384 faces, which take some seconds with software GL.
constexpr std::size_t kEstimatePoints = 64;
constexpr double kStandardErrors = 2.0;  // above the mean: a normal variable is higher in 2.3 % of cases

// Orders points as if at random, but the same everywhere (SplitMix64's finalizer; Steele, Lea, Flood 2014): the points
// that come first are a random sample of any set, and of its subsets too.
std::uint64_t shuffled(std::uint64_t code) {
  code = (code ^ code >> 30) * 0xBF58476D1CE4E5B9U;
  code = (code ^ code >> 27) * 0x94D049BB133111EBU;
  return code ^ code >> 31;
}

std::vector<glm::uvec3> sampleOf(std::vector<glm::uvec3> points) {
  const std::size_t count = std::min(points.size(), kEstimatePoints);
  std::partial_sort(points.begin(), points.begin() + static_cast<std::ptrdiff_t>(count), points.end(),
                    [](const auto& a, const auto& b) {
                      return shuffled(repository::codeOfPoint(a)) < shuffled(repository::codeOfPoint(b));
                    });
  points.resize(count);
  return points;
}

/// Estimates how many bytes the images of sampling points will take, from a few of them that it draws and encodes.
/// Draws with a GL context of its own on the thread that calls; nothing else may use that thread's context meanwhile.
class ImageBytes {
 public:
  /// All must outlive it. Errors as tuneScene().
  static base::Result<std::unique_ptr<ImageBytes>> create(const base::Scene& scene,
                                                          const lod::patch::PatchFile& patches,
                                                          const BakeOptions& options);
  /// An upper estimate of the bytes that the store's values of all faces at these points take: the true sum is higher
  /// in one of forty cases. Exact for up to kEstimatePoints points. The same points give the same estimate, and most
  /// points that were drawn for one estimate serve for the next when only some points are gone. Errors: those of
  /// drawing and encoding.
  base::Result<std::uint64_t> estimate(const std::vector<glm::uvec3>& points);

 private:
  ImageBytes(const BakeOptions& options) : options_(options) {}
  base::Result<void> measure(const std::vector<glm::uvec3>& points);

  const BakeOptions& options_;
  std::unique_ptr<base::HeadlessContext> context_;
  std::unique_ptr<SceneRenderer> renderer_;                 // goes before its context
  std::unordered_map<std::uint64_t, std::uint64_t> bytes_;  // bytes of a point's six faces, by its code
};

base::Result<std::unique_ptr<ImageBytes>> ImageBytes::create(const base::Scene& scene,
                                                             const lod::patch::PatchFile& patches,
                                                             const BakeOptions& options) {
  std::unique_ptr<ImageBytes> bytes(new ImageBytes(options));
  LUMIGRID_ASSIGN_OR_RETURN(bytes->context_, base::HeadlessContext::create());
  LUMIGRID_ASSIGN_OR_RETURN(const auto budget,
                            limitSampling({patches.hierarchy(), drawnSide(options.grid), renderOptions(options)}, 0,
                                          options.limits.resolved().memory_bytes));
  LUMIGRID_ASSIGN_OR_RETURN(bytes->renderer_, SceneRenderer::create(scene, patches, budget));
  return bytes;
}

base::Result<std::uint64_t> ImageBytes::estimate(const std::vector<glm::uvec3>& points) {
  if (points.empty()) return std::uint64_t{0};
  const std::vector<glm::uvec3> sample = sampleOf(points);
  LUMIGRID_TRY(measure(sample));
  double sum = 0.0;
  double squares = 0.0;
  for (const glm::uvec3& point : sample) {
    const auto bytes = static_cast<double>(bytes_.at(repository::codeOfPoint(point)));
    sum += bytes;
    squares += bytes * bytes;
  }
  if (sample.size() == points.size()) return static_cast<std::uint64_t>(sum);
  // The mean of a sample without replacement (Cochran 1977, section 2.6).
  const auto n = static_cast<double>(sample.size());
  const auto all = static_cast<double>(points.size());
  const double mean = sum / n;
  const double variance = std::max(0.0, (squares - n * mean * mean) / (n - 1.0));
  const double standard_error = std::sqrt(variance / n * (1.0 - n / all));
  return static_cast<std::uint64_t>(all * (mean + kStandardErrors * standard_error));
}

base::Result<void> ImageBytes::measure(const std::vector<glm::uvec3>& points) {
  std::optional<base::Error> failed;
  for (const glm::uvec3& point : points) {
    const auto [bytes, is_new] = bytes_.try_emplace(repository::codeOfPoint(point), 0);
    if (!is_new) continue;
    std::vector<repository::FaceKey> keys;
    for (std::uint32_t d = 0; d < 6; ++d) keys.push_back({point.x, point.y, point.z, d});
    const auto add = [this, &failed, sum = &bytes->second](std::size_t, RenderedPicture rendered) {
      const auto face =
          encodeFace(rendered.rgba, {options_.quality, options_.subsampling, options_.grid.tile_depth, options_.codec});
      if (face)
        *sum += face->valueBytes();
      else
        failed = face.error();
    };
    LUMIGRID_TRY(renderer_->renderMany(faceCameras(*renderer_, options_.grid, keys), renderOptions(options_), add));
  }
  LUMIGRID_TRY(renderer_->finish());
  return failed ? base::Result<void>(*failed) : base::Result<void>();
}

// Begins with the points that the views choose of the whole grid, then drops some of them, least used first.
class PointSelector {
 public:
  PointSelector(const repository::Grid& grid, std::vector<ViewDemand> demands, unsigned threads,
                const std::function<bool(double done)>& progress)
      : grid_(grid),
        demands_(std::move(demands)),
        threads_(threads),
        progress_(progress),
        worth_(worthOf(nullptr)),
        whole_worth_(worth_.sum),
        whole_points_(worth_.of_points.size()),
        tree_(treeOf(grid, mostUsed(worth_, 0.0))) {}

  bool empty() const { return whole_points_ == 0; }
  repository::SampleTree takeTree() { return std::move(tree_); }

  // As long as what is left does nearly as well.
  base::Result<void> dropDownToWorth(double worth) {
    for (double share = kMaxDropShare; share >= kMinDropShare && worth_.of_points.size() > 1;) {
      LUMIGRID_TRY(report());
      repository::SampleTree fewer = treeOf(grid_, mostUsed(worth_, share));
      Worth left = worthOf(&fewer);
      if (left.sum < worth * whole_worth_) {
        share *= 0.5;
        continue;
      }
      tree_ = std::move(fewer);
      worth_ = std::move(left);
    }
    return {};
  }

  // The share that is too much is dropped at once, but for kMaxDropShare at most: the images of points differ.
  base::Result<void> dropDownToBytes(std::uint64_t budget_bytes, ImageBytes& bytes) {
    for (;;) {
      LUMIGRID_TRY(report());
      LUMIGRID_ASSIGN_OR_RETURN(const auto estimate, bytes.estimate(tree_.points()));
      if (estimate <= budget_bytes) return {};
      const double excess = 1.0 - static_cast<double>(budget_bytes) / static_cast<double>(estimate);
      const auto kept = mostUsed(worth_, std::clamp(excess, kMinDropShare, kMaxDropShare));
      if (kept.empty())
        return base::Error{base::ErrorCode::kInvalidInput,
                           "sampling by use: the images of one point take more than the budget; raise --budget"};
      tree_ = treeOf(grid_, kept);
      worth_ = worthOf(&tree_);
    }
  }

 private:
  // With these points, or all of the grid.
  Worth worthOf(const repository::SampleTree* tree) const {
    std::vector<std::vector<plan::ChosenPoint>> chosen(demands_.size());
    base::parallelFor(demands_.size(), threads_, [&](std::size_t i) {
      plan::PointQuery query = demands_[i].query;
      query.tree = tree;
      chosen[i] = plan::choosePointsWithGains(query, demands_[i].samples);
    });
    Worth worth;
    for (const auto& of_view : chosen)
      for (const plan::ChosenPoint& c : of_view) {
        worth.sum += static_cast<double>(c.gain);
        worth.of_points[c.point] += static_cast<double>(c.gain);
      }
    return worth;
  }

  base::Result<void> report() const {
    const double left = static_cast<double>(worth_.of_points.size()) / static_cast<double>(whole_points_);
    if (!progress_ || progress_(1.0 - left)) return {};
    return base::Error{base::ErrorCode::kCancelled, "stopped; the same command begins to select points again"};
  }

  const repository::Grid& grid_;
  const std::vector<ViewDemand> demands_;
  const unsigned threads_;
  const std::function<bool(double done)>& progress_;
  Worth worth_;  // with the points of tree_
  const double whole_worth_;
  const std::size_t whole_points_;
  repository::SampleTree tree_;
};

std::vector<base::ViewCamera> viewsFor(const base::Scene& scene, const BakeOptions& options, const Enclosure& enclosure,
                                       const ViewerPlaces* places) {
  const glm::dvec3 size = scene.box_max - scene.box_min;
  const double margin = (scene.box_min.x - scene.origin.x - static_cast<double>(options.grid.first.x)) /
                        std::max({size.x, size.y, size.z});
  const RandomViews random{options.selection.views, kSeed, std::max(0.0, margin)};
  return places != nullptr ? randomViewerViews(scene, enclosure, *places, random)
                           : randomViews(scene, enclosure, random);
}

void leaveOutEnclosed(const repository::Grid& grid, const Enclosure& enclosure, unsigned threads,
                      repository::SampleTree& tree) {
  const std::vector<glm::uvec3> points = tree.points();
  std::vector<glm::vec3> places;
  places.reserve(points.size());
  for (const glm::uvec3& p : points) places.push_back(grid.point(p.x, p.y, p.z));
  const auto enclosed = enclosedPoints(enclosure, places, threads);
  for (std::size_t i = 0; i < points.size(); ++i)
    if (enclosed[i] != 0) tree.leaveOut(points[i]);
}

}  // namespace

base::Result<repository::SampleTree> selectPoints(const base::Scene& scene, const lod::patch::PatchFile& patches,
                                                  const BakeOptions& options, const ViewerPlaces* places,
                                                  const std::function<bool(double done)>& progress) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto enclosure, Enclosure::create(patches));
  LUMIGRID_ASSIGN_OR_RETURN(const auto sight, lod::patch::ProxySight::ofFile(patches));
  const auto views = viewsFor(scene, options, enclosure, places);
  PointSelector selector(options.grid, demandsOf(scene, options.grid, views, sight, options.limits.threads),
                         options.limits.threads, progress);
  if (selector.empty())
    return base::Error{base::ErrorCode::kInvalidInput,
                       "sampling by use: no view from the viewing box sees the model; raise --margin or --views"};
  LUMIGRID_TRY(selector.dropDownToWorth(options.selection.worth));
  if (options.selection.budget_bytes != 0) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, ImageBytes::create(scene, patches, options));
    LUMIGRID_TRY(selector.dropDownToBytes(options.selection.budget_bytes, *bytes));
  }
  repository::SampleTree tree = selector.takeTree();
  leaveOutEnclosed(options.grid, enclosure, options.limits.threads, tree);
  return tree;
}

base::Result<void> writeSelection(const std::string& path, const base::Scene& scene, const BakeOptions& options) {
  return base::writeFileAtomically(path, base::viewOfText(storeParameters(scene, options)));
}

base::Result<std::optional<repository::SampleTree>> readSelection(const std::string& path, const base::Scene& scene,
                                                                  const BakeOptions& options) {
  const auto bytes = base::readFile(path);
  if (!bytes && bytes.error().code == base::ErrorCode::kNotFound) return std::optional<repository::SampleTree>();
  if (!bytes) return bytes.error();
  const std::string text(bytes->begin(), bytes->end());
  BakeOptions wanted = options;
  wanted.points.reset();
  if (repository::withoutTree(text) != storeParameters(scene, wanted)) return std::optional<repository::SampleTree>();
  return repository::treeFromText(text, options.grid, path);
}

}  // namespace server
