#include "server/bake/tile_selection.h"

#include <algorithm>
#include <cstdint>
#include <unordered_map>
#include <utility>

#include "base/parallel.h"
#include "plan/view_plan.h"
#include "protocol/message.h"
#include "server/bake/tree_around.h"

namespace server {

std::size_t TileSelector::measure(const repository::SampleTree& tree) {
  protocol::Welcome welcome;
  welcome.origin = scene_.origin;
  const auto box = scene_.localBox();
  welcome.box_min = box.min;
  welcome.box_max = box.max;
  welcome.grid = grid_;
  welcome.shadows = scene_.light.hasShadows();
  plan::Scene scene;
  scene.welcome = &welcome;
  scene.hierarchy = &hierarchy_;
  scene.images = true;
  scene.sample_tree = &tree;
  scene.sight = &sight_;
  plan::Holdings patches;
  patches.group = [](std::uint32_t) { return true; };
  std::vector<plan::ViewPlan> plans(views_.size());
  base::parallelFor(views_.size(), threads_, [&](std::size_t i) {
    protocol::View view;
    view.camera = views_[i];
    plans[i] = plan::planView(scene, view, patches);
  });

  // In the order of views and of gains in each, whatever the threads did: sums of floating point depend on it.
  std::unordered_map<std::uint64_t, double> sums;
  for (const plan::ViewPlan& plan : plans)
    for (std::size_t i = 0; i < plan.face_gains.size(); ++i)
      sums[plan.faces[i].code()] += static_cast<double>(plan.face_gains[i]);
  gains_.clear();
  for (const auto& [code, gain] : sums)
    if (const auto key = repository::FaceKey::fromCode(code); key && gain > 0.0) gains_.push_back({*key, gain});
  std::sort(gains_.begin(), gains_.end(),
            [](const TileGain& a, const TileGain& b) { return a.gain != b.gain ? a.gain > b.gain : a.key < b.key; });
  return gains_.size();
}

ChosenTiles TileSelector::first(std::size_t count) const {
  ChosenTiles chosen;
  std::vector<repository::FaceKey> keys;
  for (std::size_t i = 0; i < std::min(count, gains_.size()); ++i) {
    const repository::FaceKey& key = gains_[i].key;
    keys.push_back(key);
    chosen.points.emplace_back(key.x, key.y, key.z);
  }
  std::sort(chosen.points.begin(), chosen.points.end(), comesFirst);
  chosen.points.erase(std::unique(chosen.points.begin(), chosen.points.end()), chosen.points.end());
  chosen.tiles = repository::WantedTiles(keys);
  return chosen;
}

std::size_t TileSelector::countFor(double worth) const {
  double all = 0.0;
  for (const TileGain& tile : gains_) all += tile.gain;
  double sum = 0.0;
  for (std::size_t i = 0; i < gains_.size(); ++i) {
    sum += gains_[i].gain;
    if (sum >= worth * all) return i + 1;
  }
  return gains_.size();
}

base::Result<std::size_t> TileSelector::mostThatFit(std::size_t limit,
                                                    const std::function<base::Result<bool>(std::size_t)>& fits) {
  LUMIGRID_ASSIGN_OR_RETURN(const bool all, fits(limit));
  if (all) return limit;
  std::size_t fit = 0;
  std::size_t too_many = limit;
  while (too_many - fit > 1 + limit / 100) {
    const std::size_t middle = fit + (too_many - fit) / 2;
    LUMIGRID_ASSIGN_OR_RETURN(const bool does, fits(middle));
    (does ? fit : too_many) = middle;
  }
  return fit;
}

}  // namespace server
