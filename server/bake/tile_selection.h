#pragma once
// Tiles by use: of the tiles of sampling points those are stored that gain most in views, by the same plan that decides
// what a client is sent (plan/view_plan.h). Near points get fine tiles, far ones coarse, and what the patches of a view
// show as well gets none.
#include <functional>
#include <glm/glm.hpp>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/json/scene_file.h"
#include "lod/patch/hierarchy.h"
#include "lod/patch/proxy_sight.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"
#include "repository/sampling/wanted_tiles.h"

namespace server {

struct ChosenTiles {
  std::vector<glm::uvec3> points;  ///< that have any of these tiles, sorted by comesFirst()
  repository::WantedTiles tiles;
};

class TileSelector {
 public:
  /// All must outlive it.
  TileSelector(const base::Scene& scene, const lod::patch::Hierarchy& hierarchy, const lod::patch::ProxySight& sight,
               const repository::Grid& grid, const std::vector<base::ViewCamera>& views, unsigned threads)
      : scene_(scene), hierarchy_(hierarchy), sight_(sight), grid_(grid), views_(views), threads_(threads) {}

  /// Plans all views with the images of these points, whose patches are all there. Returns how many tiles gain
  /// anything.
  std::size_t measure(const repository::SampleTree& tree);
  /// The tiles that gain most in all measured views together: so many.
  ChosenTiles first(std::size_t count) const;
  /// How many gain together `worth` of what all do.
  std::size_t countFor(double worth) const;
  /// The most of the first `limit` for which `fits`, which is false of all larger counts where it is of one; 0 where
  /// it is of all.
  static base::Result<std::size_t> mostThatFit(std::size_t limit,
                                               const std::function<base::Result<bool>(std::size_t)>& fits);

 private:
  struct TileGain {
    repository::FaceKey key;
    double gain = 0.0;
  };

  const base::Scene& scene_;
  const lod::patch::Hierarchy& hierarchy_;
  const lod::patch::ProxySight& sight_;
  const repository::Grid& grid_;
  const std::vector<base::ViewCamera>& views_;
  const unsigned threads_;
  std::vector<TileGain> gains_;  // of the points that were measured last, most first
};

}  // namespace server
