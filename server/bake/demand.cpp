#include "server/bake/demand.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <unordered_set>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "lod/patch/proxy_sight.h"
#include "plan/point_choice.h"
#include "server/bake/adaptive.h"
#include "server/bake/enclosed.h"
#include "server/bake/random_views.h"

namespace server {
namespace {

constexpr std::uint32_t kSeed = 20111;     // other views than those that `lumigrid tour --random` holds out
constexpr std::size_t kPointsPerView = 8;  // a client's default
constexpr float kProxyError = 4.0F;        // pixels, of its proxy
constexpr double kFirstShare = 0.25;       // of the points: so many of the least used go at a time,
constexpr double kMinShare = 0.01;         // and where that is too many half as many, down to this

bool comesFirst(const glm::uvec3& a, const glm::uvec3& b) {
  return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z);
}
struct PointOrder {
  bool operator()(const glm::uvec3& a, const glm::uvec3& b) const { return comesFirst(a, b); }
};

/// What the choice for all views adds up to, in all and by point.
struct Worth {
  double all = 0.0;
  std::map<glm::uvec3, double, PointOrder> of_points;
};

/// A view, and the surface that it shows.
struct Look {
  plan::PointQuery query;
  std::vector<plan::SurfaceSample> samples;
};

std::vector<Look> looksOf(const base::Scene& scene, const repository::Grid& grid,
                          const std::vector<base::ViewCamera>& views, const lod::patch::ProxySight& sight,
                          unsigned threads) {
  const glm::vec3 center(0.5 * (scene.box_min + scene.box_max) - scene.origin);
  const float radius = 0.5F * static_cast<float>(glm::length(scene.box_max - scene.box_min));
  std::vector<Look> looks(views.size());
  base::parallelFor(views.size(), threads, [&](std::size_t i) {
    const base::DepthRange depth = base::depthRangeFor(glm::vec3(views[i].position - scene.origin), center, radius);
    const base::Camera camera = base::cameraFromView(views[i], scene.origin, depth.near_plane, depth.far_plane);
    plan::PointQuery& query = looks[i].query;
    query.grid = grid;
    query.sight = &sight;
    query.eye = camera.eye;
    query.pixels_per_unit_at_one = camera.pixelsPerUnitAtOne();
    query.error_px = kProxyError;
    query.max_points = kPointsPerView;
    looks[i].samples = plan::sampleVisibleSurface(sight, camera);
  });
  return looks;
}

Worth worthWith(const repository::SampleTree* tree, const std::vector<Look>& looks, unsigned threads) {
  std::vector<std::vector<plan::ChosenPoint>> chosen(looks.size());
  base::parallelFor(looks.size(), threads, [&](std::size_t i) {
    plan::PointQuery query = looks[i].query;
    query.tree = tree;
    chosen[i] = plan::choosePointsWithGains(query, looks[i].samples);
  });
  Worth worth;
  for (const auto& of_view : chosen)
    for (const plan::ChosenPoint& c : of_view) {
      worth.all += static_cast<double>(c.gain);
      worth.of_points[c.point] += static_cast<double>(c.gain);
    }
  return worth;
}

/// The cells of `size` steps that have one of these points within or on a side, by their places among such cells.
std::unordered_set<std::uint64_t> cellsAround(const std::vector<glm::uvec3>& points, std::uint32_t size) {
  std::unordered_set<std::uint64_t> cells;
  for (const glm::uvec3& p : points)
    for (std::uint32_t i = 0; i < 8; ++i) {
      const glm::uvec3 below(std::min(p.x, i & 1), std::min(p.y, i >> 1 & 1), std::min(p.z, i >> 2));
      const glm::uvec3 cell = (p - below) / size;
      cells.insert(repository::FaceKey{cell.x, cell.y, cell.z, 0}.code());
    }
  return cells;
}

/// Cells are split down to single steps around each of these points, so that whoever looks there finds it.
repository::SampleTree treeOf(const repository::Grid& grid, const std::vector<glm::uvec3>& points) {
  repository::SampleTree tree(grid, coarseCellSize(grid, 1));
  for (auto open = tree.openLeaves(); !open.empty(); open = tree.openLeaves()) {
    const std::uint32_t size = open.front().size;  // all have the same: each round splits or closes all
    const auto around = cellsAround(points, size);
    for (const repository::SampleTree::Cell& cell : open) {
      const glm::uvec3 at = cell.corner / size;
      around.count(repository::FaceKey{at.x, at.y, at.z, 0}.code()) != 0 ? tree.split(cell) : tree.close(cell);
    }
  }
  for (const glm::uvec3& p : tree.points())
    if (!std::binary_search(points.begin(), points.end(), p, comesFirst)) tree.leaveOut(p);
  return tree;
}

/// All but the least used `share`, in order.
std::vector<glm::uvec3> mostUsed(const Worth& worth, double share) {
  std::vector<std::pair<double, glm::uvec3>> ranked;
  for (const auto& [point, gain] : worth.of_points) ranked.emplace_back(gain, point);
  std::sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) {
    return a.first != b.first ? a.first > b.first : comesFirst(a.second, b.second);
  });
  const auto gone = static_cast<std::size_t>(std::ceil(share * static_cast<double>(ranked.size())));
  std::vector<glm::uvec3> kept;
  for (std::size_t i = 0; i + gone < ranked.size(); ++i) kept.push_back(ranked[i].second);
  std::sort(kept.begin(), kept.end(), comesFirst);
  return kept;
}

}  // namespace

base::Result<repository::SampleTree> treeInDemand(const base::Scene& scene, const lod::patch::PatchFile& patches,
                                                  const repository::Grid& grid, const DemandOptions& options,
                                                  const std::function<bool(double done)>& progress) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto enclosure, Enclosure::create(patches));
  LUMIGRID_ASSIGN_OR_RETURN(const auto sight, lod::patch::ProxySight::ofFile(patches));
  const glm::dvec3 size = scene.box_max - scene.box_min;
  const double margin =
      (scene.box_min.x - scene.origin.x - static_cast<double>(grid.first.x)) / std::max({size.x, size.y, size.z});
  const auto views = randomViews(scene, enclosure, {options.views, kSeed, std::max(0.0, margin)});
  const auto looks = looksOf(scene, grid, views, sight, options.threads);

  // The whole grid first; then fewer and fewer, as long as what is left does nearly as well.
  Worth worth = worthWith(nullptr, looks, options.threads);
  if (worth.of_points.empty())
    return base::Error{base::ErrorCode::kInvalidInput,
                       "sampling by use: no view from the viewing box sees the model; raise --margin or --views"};
  const double enough = options.worth * worth.all;
  const auto all_chosen = static_cast<double>(worth.of_points.size());
  repository::SampleTree tree = treeOf(grid, mostUsed(worth, 0.0));
  for (double share = kFirstShare; share >= kMinShare && worth.of_points.size() > 1;) {
    if (progress && !progress(1.0 - static_cast<double>(worth.of_points.size()) / all_chosen))
      return base::Error{base::ErrorCode::kCancelled, "stopped; the same command begins to choose points again"};
    repository::SampleTree fewer = treeOf(grid, mostUsed(worth, share));
    Worth left = worthWith(&fewer, looks, options.threads);
    if (left.all < enough) {
      share *= 0.5;
      continue;
    }
    tree = std::move(fewer);
    worth = std::move(left);
  }
  return tree;
}

}  // namespace server
