#include "server/bake/adaptive.h"

#include <algorithm>
#include <array>
#include <optional>
#include <unordered_set>
#include <utility>

#include "server/bake/cell_judge.h"
#include "server/bake/enclosed.h"

namespace server {
namespace {

using Cell = repository::SampleTree::Cell;

constexpr std::size_t kCellsPerSave = 32;  // a killed build judges so many again

class Sampler {
 public:
  Sampler(AdaptiveWork& work, repository::SampleTree& tree, const Enclosure& enclosure, CellJudge& judge,
          std::vector<repository::TreeGrowth> growth)
      : work_(work), tree_(tree), enclosure_(enclosure), judge_(judge), growth_(std::move(growth)) {}

  base::Result<std::vector<repository::TreeGrowth>> run() {
    for (;;) {
      LUMIGRID_TRY(renderPoints());
      const std::vector<Cell> open = largestOpen();
      if (open.empty()) break;
      const std::vector<Cell> round = byUse(open);
      if (!round.empty()) LUMIGRID_TRY(judgeRound(round));
      LUMIGRID_TRY(save());
    }
    return std::move(growth_);
  }

 private:
  glm::vec3 place(const glm::uvec3& p) const { return work_.options.grid.point(p.x, p.y, p.z); }

  // New points get their images, but for those within the model; what sees nothing goes.
  base::Result<void> renderPoints() {
    std::vector<glm::uvec3> fresh;
    std::vector<glm::vec3> places;
    for (const glm::uvec3& p : tree_.points()) {
      if (!looked_.insert(repository::FaceKey{p.x, p.y, p.z, 0}.code()).second) continue;
      fresh.push_back(p);
      places.push_back(place(p));
    }
    const auto enclosed = enclosedPoints(enclosure_, places, work_.options.threads);
    for (std::size_t i = 0; i < fresh.size(); ++i)
      if (enclosed[i] != 0) tree_.leaveOut(fresh[i]);
    LUMIGRID_TRY(save());

    LUMIGRID_ASSIGN_OR_RETURN(const auto blind, work_.render(tree_.points()));
    std::vector<repository::FaceKey> gone;
    for (const glm::uvec3& p : blind) {
      tree_.leaveOut(p);
      for (std::uint32_t d = 0; d < 6; ++d) gone.push_back({p.x, p.y, p.z, d});
    }
    // In this order: a build killed between the two renders them again; it leaves no images that nobody expects.
    if (!gone.empty()) LUMIGRID_TRY(work_.store.erase(gone));
    return save();
  }

  // Of the cells of a round those that viewers come to, most used first; the others stay as they are.
  std::vector<Cell> byUse(std::vector<Cell> round) {
    if (!work_.options.use) return round;
    std::vector<std::pair<double, Cell>> ranked;
    for (const Cell& cell : round) {
      const auto corners = tree_.cornersOf(cell);
      const double use = work_.options.use(place(corners[0]), place(corners[7]));
      if (use > 0.0)
        ranked.emplace_back(use, cell);
      else
        tree_.close(cell);
    }
    std::stable_sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
    round.clear();
    for (const auto& [use, cell] : ranked) round.push_back(cell);
    return round;
  }

  std::vector<Cell> largestOpen() const {
    std::vector<Cell> open = tree_.openLeaves();
    std::uint32_t size = 0;
    for (const Cell& cell : open) size = std::max(size, cell.size);
    std::erase_if(open, [&](const Cell& cell) { return cell.size != size; });
    return open;
  }

  base::Result<void> judgeRound(const std::vector<Cell>& round) {
    repository::TreeGrowth row;
    row.cell = round.front().size;
    row.cells = tree_.leafCount();
    row.points = tree_.points().size();
    row.bytes = work_.stored_bytes();
    base::PictureError all;
    for (std::size_t i = 0; i < round.size(); ++i) {
      if (!tell(row, i, round.size())) {
        LUMIGRID_TRY(save());
        return base::Error{base::ErrorCode::kCancelled, "stopped; the same command goes on where it stopped"};
      }
      LUMIGRID_ASSIGN_OR_RETURN(const auto error, judge(round[i]));
      all.add(error);
      row.worst_psnr_db = std::min(row.worst_psnr_db, error.psnr());
      bool split = error.psnr() < work_.options.target_db && !isSpent(row);
      if (split) {
        LUMIGRID_ASSIGN_OR_RETURN(const auto gain, gainOf(round[i]));
        split = gain >= work_.options.least_gain_db;
      }
      if (split) {
        tree_.split(round[i]);
        ++row.split;
      } else {
        tree_.close(round[i]);
      }
      if (i % kCellsPerSave == kCellsPerSave - 1) LUMIGRID_TRY(save());
    }
    row.psnr_db = all.psnr();
    growth_.push_back(row);
    return {};
  }

  // Whether the images would take more than the budget, at the mean of what the points until now take.
  bool isSpent(const repository::TreeGrowth& row) const {
    if (work_.options.budget_bytes == 0 || row.points == 0) return false;
    const double each = static_cast<double>(row.bytes) / static_cast<double>(row.points);
    return each * static_cast<double>(tree_.points().size()) > static_cast<double>(work_.options.budget_bytes);
  }

  bool tell(const repository::TreeGrowth& row, std::size_t done, std::size_t total) const {
    BakeProgress progress;
    progress.stored_bytes = row.bytes;
    progress.cell = row.cell;
    progress.cells_judged = done;
    progress.cells_total = total;
    return work_.progress(progress);
  }

  std::vector<glm::uvec3> pointsOf(const Cell& cell) const {
    std::vector<glm::uvec3> points;
    for (const glm::uvec3& p : tree_.cornersOf(cell))
      if (tree_.hasPoint(p) && std::find(points.begin(), points.end(), p) == points.end()) points.push_back(p);
    return points;
  }
  glm::vec3 within(const Cell& cell, const glm::vec3& at) const {
    const auto corners = tree_.cornersOf(cell);
    return glm::mix(place(corners[0]), place(corners[7]), at);
  }

  // From the cell's centre, where its corners are farthest; from a place half-way to one where the centre is behind the
  // surface. What views from behind it miss would split every cell along a terrain.
  base::Result<base::PictureError> judge(const Cell& cell) {
    const auto eye = placeToLookFrom(cell, 0);
    if (!eye) return base::PictureError();  // nobody can be there
    return judge_.judge(work_.renderer, *eye, pointsOf(cell));
  }

  // What an image from the centre would add for who is half-way to a corner, in dB: close to a surface pictures are bad
  // however many there are, and splitting would go on to the finest grid for nothing.
  base::Result<double> gainOf(const Cell& cell) {
    const auto eye = placeToLookFrom(cell, 1);
    if (!eye) return 0.0;
    LUMIGRID_ASSIGN_OR_RETURN(const auto errors,
                              judge_.judgeWith(work_.renderer, *eye, pointsOf(cell), within(cell, glm::vec3(0.5F))));
    return errors.second.psnr() - errors.first.psnr();
  }

  // The centre (0), then places half-way to the corners (1 …), from number `first` on.
  std::optional<glm::vec3> placeToLookFrom(const Cell& cell, std::size_t first) const {
    static constexpr std::array<std::array<float, 3>, 9> kEyes{{{0.5F, 0.5F, 0.5F},
                                                                {0.25F, 0.25F, 0.25F},
                                                                {0.75F, 0.75F, 0.25F},
                                                                {0.75F, 0.25F, 0.75F},
                                                                {0.25F, 0.75F, 0.75F},
                                                                {0.75F, 0.75F, 0.75F},
                                                                {0.25F, 0.25F, 0.75F},
                                                                {0.25F, 0.75F, 0.25F},
                                                                {0.75F, 0.25F, 0.25F}}};
    for (std::size_t i = first; i < kEyes.size(); ++i) {
      const glm::vec3 eye = within(cell, {kEyes[i][0], kEyes[i][1], kEyes[i][2]});
      if (!enclosure_.isBehind(eye)) return eye;
    }
    return std::nullopt;
  }

  base::Result<void> save() { return work_.store.writeMeta(repository::withTree(work_.parameters, tree_, growth_)); }

  AdaptiveWork& work_;
  repository::SampleTree& tree_;
  const Enclosure& enclosure_;
  CellJudge& judge_;
  std::vector<repository::TreeGrowth> growth_;
  std::unordered_set<std::uint64_t> looked_;  // points known to be left out or not
};

}  // namespace

std::uint32_t coarseCellSize(const repository::Grid& grid, std::uint32_t cells) {
  const std::uint32_t steps = std::max({grid.count.x, grid.count.y, grid.count.z}) - 1;
  std::uint32_t size = 1;
  while (2 * std::uint64_t{size} * cells <= steps) size *= 2;
  return size;
}

base::Result<std::vector<repository::TreeGrowth>> sampleAdaptively(AdaptiveWork& work, repository::SampleTree& tree) {
  LUMIGRID_ASSIGN_OR_RETURN(auto enclosure, Enclosure::create(work.patches));
  JudgeOptions options;
  options.truth.tolerance_px = work.options.tolerance_px;
  options.truth.supersampling = work.options.supersampling;
  options.view_size = std::min(options.view_size, static_cast<int>(work.options.grid.face_size));
  LUMIGRID_ASSIGN_OR_RETURN(auto judge,
                            CellJudge::create(work.scene, work.patches, work.store, work.options.grid, options));
  LUMIGRID_ASSIGN_OR_RETURN(const auto text, work.store.readMeta());
  return Sampler(work, tree, enclosure, *judge,
                 text ? repository::growthFromText(*text) : std::vector<repository::TreeGrowth>())
      .run();
}

}  // namespace server
