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
#include "server/bake/image_sizes.h"
#include "server/bake/tile_selection.h"
#include "server/bake/tree_around.h"
#include "server/views/enclosed.h"
#include "server/views/indoors.h"

namespace server {
namespace {

constexpr std::uint32_t kSeed = 20111;  // gives other views than the held-out ones of `lumigrid tour --random`
constexpr double kMaxDropShare = 0.25;  // so large a share of the points, the least used, is dropped at a time …
constexpr double kMinDropShare = 0.01;  // … and half as many where that is too many, down to this; choices

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

base::Error budgetTooSmall() {
  return {base::ErrorCode::kInvalidInput,
          "sampling by use: the images of one point take more than the budget; raise --budget"};
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
        tree_(treeAround(grid, mostUsed(worth_, 0.0))) {}

  bool empty() const { return whole_points_ == 0; }
  repository::SampleTree takeTree() { return std::move(tree_); }

  // As long as what is left does nearly as well.
  base::Result<void> dropDownToWorth(double worth) {
    for (double share = kMaxDropShare; share >= kMinDropShare && worth_.of_points.size() > 1;) {
      LUMIGRID_TRY(report());
      repository::SampleTree fewer = treeAround(grid_, mostUsed(worth_, share));
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
  base::Result<void> dropDownToBytes(std::uint64_t budget_bytes, ImageSizes& sizes) {
    for (;;) {
      LUMIGRID_TRY(report());
      LUMIGRID_ASSIGN_OR_RETURN(const auto estimate, sizes.estimate(tree_.points()));
      if (estimate <= budget_bytes) return {};
      const double excess = 1.0 - static_cast<double>(budget_bytes) / static_cast<double>(estimate);
      const auto kept = mostUsed(worth_, std::clamp(excess, kMinDropShare, kMaxDropShare));
      if (kept.empty()) return budgetTooSmall();
      tree_ = treeAround(grid_, kept);
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
                                       const Indoors* indoors, const ViewerPlaces* places) {
  const glm::dvec3 size = scene.box_max - scene.box_min;
  const double margin = (scene.box_min.x - scene.origin.x - static_cast<double>(options.grid.first.x)) /
                        std::max({size.x, size.y, size.z});
  RandomViews random{options.selection.views, kSeed, std::max(0.0, margin)};
  random.indoors = indoors;
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

/// Leaves out tiles that gain little, and points that have none left: fewer points gain more each, so their tiles are
/// measured again.
base::Result<repository::WantedTiles> selectTiles(TileSelector& selector, const BakeOptions& options, ImageSizes* sizes,
                                                  repository::SampleTree& tree) {
  constexpr int kRounds = 3;  // a choice
  for (int round = 1;; ++round) {
    if (selector.measure(tree) == 0) {
      // Patches show all as well, in these views. What is left of images is small.
      repository::WantedTiles none;
      if (sizes == nullptr) return none;
      LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, sizes->estimate(tree.points(), &none));
      return bytes <= options.selection.budget_bytes ? base::Result<repository::WantedTiles>(none) : budgetTooSmall();
    }
    std::size_t count = selector.countFor(options.selection.worth);
    if (sizes != nullptr) {
      const auto fits = [&](std::size_t first) -> base::Result<bool> {
        const ChosenTiles chosen = selector.first(first);
        LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, sizes->estimate(chosen.points, &chosen.tiles));
        return bytes <= options.selection.budget_bytes;
      };
      LUMIGRID_ASSIGN_OR_RETURN(count, TileSelector::mostThatFit(count, fits));
    }
    ChosenTiles chosen = selector.first(count);
    if (chosen.points.empty()) return budgetTooSmall();
    const bool is_same = chosen.points.size() == tree.points().size();
    if (!is_same) tree = treeAround(options.grid, chosen.points);
    if (is_same || round == kRounds) return std::move(chosen.tiles);
  }
}

}  // namespace

base::Result<Selection> selectImages(const base::Scene& scene, const lod::patch::PatchFile& patches,
                                     const BakeOptions& options, const ViewerPlaces* places,
                                     const std::function<bool(double done)>& progress) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto enclosure, Enclosure::create(patches));
  LUMIGRID_ASSIGN_OR_RETURN(const auto sight, lod::patch::ProxySight::ofFile(patches));
  const bool is_seen_from_rooms = places == nullptr && scene.interior;
  const auto indoors = is_seen_from_rooms ? Indoors::find(sight, scene.localBox(), glm::vec3(glm::normalize(scene.up)))
                                          : std::optional<Indoors>();
  const auto views = viewsFor(scene, options, enclosure, indoors ? &*indoors : nullptr, places);
  PointSelector selector(options.grid, demandsOf(scene, options.grid, views, sight, options.limits.threads),
                         options.limits.threads, progress);
  if (selector.empty())
    return base::Error{base::ErrorCode::kInvalidInput,
                       "sampling by use: no view from the viewing box sees the model; raise --margin or --views"};
  LUMIGRID_TRY(selector.dropDownToWorth(options.selection.worth));
  std::unique_ptr<ImageSizes> sizes;
  if (options.selection.budget_bytes != 0) {
    LUMIGRID_ASSIGN_OR_RETURN(sizes, ImageSizes::create(scene, patches, options));
    if (!options.grid.isTiled()) LUMIGRID_TRY(selector.dropDownToBytes(options.selection.budget_bytes, *sizes));
  }
  Selection selection{selector.takeTree(), std::nullopt};
  if (options.grid.isTiled()) {
    TileSelector tiles(scene, patches.hierarchy(), sight, options.grid, views, options.limits.threads);
    LUMIGRID_ASSIGN_OR_RETURN(selection.tiles, selectTiles(tiles, options, sizes.get(), selection.points));
  }
  leaveOutEnclosed(options.grid, enclosure, options.limits.threads, selection.points);
  return selection;
}

base::Result<Selection> selectPointsInRooms(const base::Scene& scene, const lod::patch::PatchFile& patches,
                                            const BakeOptions& options) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto indoors, Indoors::ofScene(scene, patches));
  const std::vector<glm::uvec3> points = repository::SampleTree(options.grid, 1).points();
  std::vector<std::uint8_t> sees(points.size(), 0);
  base::parallelFor(indoors ? points.size() : 0, options.limits.threads, [&](std::size_t i) {
    sees[i] = indoors->seesRooms(options.grid.point(points[i].x, points[i].y, points[i].z)) ? 1 : 0;
  });
  std::vector<glm::uvec3> kept;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (sees[i] != 0) kept.push_back(points[i]);
  if (kept.empty()) kept = points;
  std::sort(kept.begin(), kept.end(), comesFirst);
  return Selection{treeAround(options.grid, kept), std::nullopt};
}

base::Result<void> writeSelection(const std::string& path, const base::Scene& scene, const BakeOptions& options) {
  return base::writeFileAtomically(path, base::viewOfText(storeParameters(scene, options)));
}

base::Result<std::optional<Selection>> readSelection(const std::string& path, const base::Scene& scene,
                                                     const BakeOptions& options) {
  const auto bytes = base::readFile(path);
  if (!bytes && bytes.error().code == base::ErrorCode::kNotFound) return std::optional<Selection>();
  if (!bytes) return bytes.error();
  const std::string text(bytes->begin(), bytes->end());
  BakeOptions wanted = options;
  wanted.points.reset();
  wanted.tiles.reset();
  if (repository::withoutSelection(text) != storeParameters(scene, wanted)) return std::optional<Selection>();
  LUMIGRID_ASSIGN_OR_RETURN(auto points, repository::treeFromText(text, options.grid, path));
  if (!points) return std::optional<Selection>();
  auto tiles = repository::tilesFromText(text, options.grid, path);
  if (!tiles) return tiles.error();
  return std::optional(Selection{std::move(*points), std::move(*tiles)});
}

}  // namespace server
