#include "server/bake/bake.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <sstream>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/egl/headless.h"
#include "repository/faces/face_value.h"
#include "repository/sampling/parameters.h"
#include "server/bake/adaptive.h"
#include "server/bake/cell_judge.h"
#include "server/bake/committer.h"
#include "server/bake/demand.h"
#include "server/bake/draw_memory.h"
#include "server/bake/draw_processes.h"
#include "server/bake/face_maker.h"

// Stages, each on its own threads or in processes of their own: dealing out grid points (this thread), drawing, reading
// back and encoding (FaceMaker), committing (the Committer's thread). Queues between them are bounded, so a slow disk
// slows the drawing down and memory stays small.

namespace server {
namespace {

constexpr std::uint64_t kMaxPoints = std::uint64_t{1} << 26;
constexpr double kRateSeconds = 15.0;  // the rate shown is that of so long

using Clock = std::chrono::steady_clock;
double secondsBetween(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

// ---- The store's parameters ----

std::string numbers(const glm::vec3& v) {
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "[%.9g, %.9g, %.9g]", static_cast<double>(v.x), static_cast<double>(v.y),
                static_cast<double>(v.z));
  return text.data();
}

std::string number(float v) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.9g", static_cast<double>(v));
  return text.data();
}

// All that decides the bytes of a face, as JSON with one parameter a line, so that a difference can be told by its
// line.
std::string parametersText(const base::Scene& scene, const BakeOptions& options) {
  const repository::Grid& grid = options.grid;
  std::string patch_sha256;
  for (const base::ScenePart& part : scene.parts) {
    if (part.file == "patch.lgp") patch_sha256 = part.sha256;
  }
  std::ostringstream text;
  text << "{\n\"version\": 1"
       << ",\n\"grid\": {\"first\": " << numbers(grid.first) << ", \"spacing\": " << number(grid.spacing)
       << ", \"count\": [" << grid.count.x << ", " << grid.count.y << ", " << grid.count.z << "]"
       << ", \"face_size\": " << grid.face_size << "},\n\"quality\": " << options.quality << ",\n\"subsampling\": \""
       << repository::nameOf(options.subsampling) << "\""
       << ",\n\"tolerance\": " << number(options.tolerance_px) << ",\n\"supersampling\": " << options.supersampling
       << ",\n\"light\": \"" << (scene.light.mode == base::LightMode::kUnlit ? "unlit" : "soft") << "\""
       << ",\n\"light direction\": " << numbers(scene.light.direction) << ",\n\"patch.lgp\": \"" << patch_sha256
       << "\"";
  if (options.target_db > 0.0)
    text << ",\n\"target\": " << number(static_cast<float>(options.target_db))
         << ",\n\"least gain\": " << number(static_cast<float>(options.least_gain_db))
         << ",\n\"budget\": " << options.budget_bytes << ",\n\"by use\": " << (options.use ? "true" : "false")
         << ",\n\"coarse cells\": " << options.coarse_cells;
  if (options.demand_views > 0)
    text << ",\n\"demand views\": " << options.demand_views
         << ",\n\"demand worth\": " << number(static_cast<float>(options.demand_worth));
  text << "\n}\n";
  return text.str();
}

base::Result<void> claimStore(repository::Store& store, const std::string& wanted) {
  const auto other = [](const std::string& what) {
    return base::Error{base::ErrorCode::kExists, "the image repository was built with " + what +
                                                     "; give the same options, or --force to build it anew"};
  };
  LUMIGRID_ASSIGN_OR_RETURN(auto stored, store.readMeta());
  if (stored)
    return repository::sameParameters(*stored, wanted)
               ? base::Result<void>()
               : base::Result<void>(other(repository::firstDifference(*stored, wanted)));
  LUMIGRID_ASSIGN_OR_RETURN(auto size, store.size());
  if (size > 0) return other("unknown parameters");
  return store.writeMeta(wanted);
}

// ---- What is there already ----

// One bit a face of the grid: its value is in the store and whole.
class Present {
 public:
  Present(const repository::Grid& grid, const repository::Shard& shard)
      : grid_(grid), points_(repository::pointsOf(shard, grid)), bits_(grid.faceCount(), false) {}

  base::Result<void> read(const repository::Store& store) {
    return store.forEach([&](const repository::FaceKey& key, base::ByteView value) {
      if (!expected(key) || !repository::decodeFaceValue(value)) return true;
      bits_[index(key)] = true;
      ++count_;
      bytes_ += value.size();
      return true;
    });
  }
  bool has(const repository::FaceKey& key) const { return bits_[index(key)]; }
  void add(const repository::FaceKey& key) {
    count_ += bits_[index(key)] ? 0 : 1;
    bits_[index(key)] = true;
  }
  void addBytes(std::uint64_t bytes) { bytes_ += bytes; }
  std::uint64_t count() const { return count_; }
  std::uint64_t bytes() const { return bytes_; }

 private:
  bool expected(const repository::FaceKey& key) const {
    return grid_.contains(key) && points_.contains(repository::mortonRank(grid_, {key.x, key.y, key.z}));
  }
  std::size_t index(const repository::FaceKey& key) const {
    return static_cast<std::size_t>(((std::uint64_t{key.z} * grid_.count.y + key.y) * grid_.count.x + key.x) * 6 +
                                    key.d);
  }
  const repository::Grid& grid_;
  const repository::PointRange points_;
  std::vector<bool> bits_;
  std::uint64_t count_ = 0;
  std::uint64_t bytes_ = 0;
};

// ---- Counting ----

struct Counters {
  std::atomic<std::uint64_t> done{0}, empty{0}, jpeg_bytes{0}, coverage_bytes{0}, value_bytes{0};

  void add(const EncodedFace& face) {
    empty += face.empty ? 1 : 0;
    jpeg_bytes += face.jpeg_bytes;
    coverage_bytes += face.coverage_bytes;
    value_bytes += face.value.size();
    ++done;
  }
};

// Faces a second over the last moments.
class MovingRate {
 public:
  double update(Clock::time_point now, std::uint64_t done) {
    samples_.emplace_back(now, done);
    while (samples_.size() > 2 && secondsBetween(samples_[1].first, now) > kRateSeconds) samples_.pop_front();
    const double seconds = secondsBetween(samples_.front().first, now);
    return seconds > 0.0 ? static_cast<double>(done - samples_.front().second) / seconds : 0.0;
  }

 private:
  std::deque<std::pair<Clock::time_point, std::uint64_t>> samples_;
};

// ---- The work ----

/// Faces that may be under way at a time.
std::uint64_t windowOf(const BakeOptions& options) {
  return 2 * std::uint64_t{options.batch_faces} + 16 * threadsOf(options);
}

class Baker {
 public:
  Baker(const base::Scene& scene, const lod::patch::PatchFile& patches, repository::Store& store,
        const BakeOptions& options, const DrawLimits& limits, const Present& present,
        const std::vector<glm::uvec3>& points)
      : options_(options),
        present_(present),
        points_(points),
        committer_(store, options.batch_faces, windowOf(options)),
        faces_(makeFaces({scene, patches, options.grid, renderOptions(options), options.quality, options.subsampling,
                          limits.gpu_budget_bytes},
                         limits)) {}

  base::Result<void> run(const std::function<bool(const BakeProgress&)>& progress) {
    for (const glm::uvec3& point : points_) skipped_ += 6 - missingAt(point).size();
    bool cancelled = !progress(progressNow());
    std::uint64_t sequence = 0;
    for (const glm::uvec3& point : points_) {
      if (cancelled) break;
      DrawJob job{sequence, missingAt(point)};
      if (job.keys.empty()) continue;
      sequence += job.keys.size();
      if (!committer_.waitForRoom(sequence - 1)) break;
      faces_->submit(std::move(job));
      cancelled = !progress(progressNow());
    }

    // What is drawn is kept, also after a cancellation.
    faces_->finish();
    LUMIGRID_TRY(committer_.finish());
    if (cancelled)
      return base::Error{base::ErrorCode::kCancelled, "stopped; the same command goes on where it stopped"};
    progress(progressNow());
    return {};
  }
  const Counters& counters() const { return counters_; }
  /// How many faces rendered at the point see nothing.
  std::uint32_t emptyAt(const glm::uvec3& p) const {
    const auto at = empty_.find(repository::FaceKey{p.x, p.y, p.z, 0}.code());
    return at == empty_.end() ? 0 : at->second;
  }

 private:
  std::vector<repository::FaceKey> missingAt(const glm::uvec3& point) const {
    std::vector<repository::FaceKey> keys;
    for (std::uint32_t d = 0; d < 6; ++d) {
      const repository::FaceKey key{point.x, point.y, point.z, d};
      if (!present_.has(key)) keys.push_back(key);
    }
    return keys;
  }

  std::unique_ptr<FaceMaker> makeFaces(const FaceWork& work, const DrawLimits& limits) {
    FaceMaker::Take take = [this](std::uint64_t sequence, const repository::FaceKey& key, EncodedFace face) {
      this->take(sequence, key, std::move(face));
    };
    FaceMaker::Fail fail = [this](const base::Error& error) { committer_.fail(error); };
    if (limits.processes == 0) return makeFacesHere(work, limits.encoders, std::move(take), std::move(fail));
    const auto processes = std::min<std::size_t>(limits.processes, points_.size());
    return makeFacesByProcesses(work, options_.draw_command, static_cast<unsigned>(processes), std::move(take),
                                std::move(fail));
  }

  // A face has come.
  void take(std::uint64_t sequence, const repository::FaceKey& key, EncodedFace face) {
    counters_.add(face);
    if (face.empty) {
      const std::lock_guard lock(empty_mutex_);
      ++empty_[repository::FaceKey{key.x, key.y, key.z, 0}.code()];
    }
    committer_.deliver(sequence, key, std::move(face.value));
  }

  BakeProgress progressNow() {
    BakeProgress now;
    now.faces_done = counters_.done;
    now.faces_skipped = skipped_;
    now.faces_total = 6 * points_.size();
    now.stored_bytes = present_.bytes() + counters_.value_bytes;
    now.faces_per_second = rate_.update(Clock::now(), now.faces_done);
    const auto left = static_cast<double>(now.faces_total - now.faces_skipped - now.faces_done);
    now.seconds_left = now.faces_per_second > 0.0 ? left / now.faces_per_second : 0.0;
    return now;
  }

  const BakeOptions& options_;
  const Present& present_;
  const std::vector<glm::uvec3>& points_;
  std::uint64_t skipped_ = 0;
  std::mutex empty_mutex_;
  std::unordered_map<std::uint64_t, std::uint32_t> empty_;  // by the point's first key: faces that see nothing
  Counters counters_;
  MovingRate rate_;
  Committer committer_;
  std::unique_ptr<FaceMaker> faces_;  // last: it uses the others
};

// A store, what it holds and what fills it.
class Work {
 public:
  Work(const base::Scene& scene, const lod::patch::PatchFile& patches, repository::Store& store,
       const BakeOptions& options, const std::function<bool(const BakeProgress&)>& progress)
      : scene_(scene),
        patches_(patches),
        store_(store),
        options_(options),
        progress_(progress),
        parameters_(parametersText(scene, options)),
        present_(options.grid, options.shard) {}

  base::Result<BakeSummary> run() {
    LUMIGRID_TRY(claimStore(store_, parameters_));
    LUMIGRID_TRY(present_.read(store_));
    summary_.faces_skipped = present_.count();
    if (isAdaptive(options_))
      LUMIGRID_TRY(sampleTree());
    else
      LUMIGRID_TRY(sampleAll());
    return summary_;
  }

 private:
  base::Result<void> sampleAll() {
    const repository::PointRange range = repository::pointsOf(options_.shard, options_.grid);
    summary_.points = range.size();
    if (present_.count() == 6 * range.size()) return {};
    std::vector<glm::uvec3> points;
    points.reserve(range.size());
    for (std::uint64_t rank = range.first; rank < range.end; ++rank)
      points.push_back(repository::pointAtMortonRank(options_.grid, rank));
    const auto blind = render(points);
    return blind ? base::Result<void>() : base::Result<void>(blind.error());
  }

  // What to begin with: cells to judge, or the points in demand.
  base::Result<repository::SampleTree> firstTree() {
    if (options_.demand_views == 0)
      return repository::SampleTree(options_.grid, coarseCellSize(options_.grid, options_.coarse_cells));
    return treeInDemand(scene_, patches_, options_.grid,
                        {options_.demand_views, options_.demand_worth, options_.threads},
                        [this](double) { return !progress_ || progress_({}); });
  }

  base::Result<void> sampleTree() {
    LUMIGRID_ASSIGN_OR_RETURN(const auto meta, store_.readMeta());
    const std::string text = meta.value_or("");
    LUMIGRID_ASSIGN_OR_RETURN(auto stored, repository::treeFromText(text, options_.grid, "the image repository"));
    if (stored && isComplete(*stored)) {
      summary_.growth = repository::growthFromText(text);
      summary_.points = stored->points().size();
      return {};
    }
    LUMIGRID_ASSIGN_OR_RETURN(auto first,
                              stored ? base::Result<repository::SampleTree>(std::move(*stored)) : firstTree());
    repository::SampleTree tree = std::move(first);
    LUMIGRID_TRY(start());
    AdaptiveWork work{scene_,
                      patches_,
                      store_,
                      options_,
                      *renderer_,
                      parameters_,
                      [this](const std::vector<glm::uvec3>& points) { return render(points); },
                      [this] { return present_.bytes(); },
                      progress_};
    LUMIGRID_ASSIGN_OR_RETURN(auto growth, sampleAdaptively(work, tree));
    summary_.growth = std::move(growth);
    summary_.points = tree.points().size();
    return {};
  }

  bool isComplete(const repository::SampleTree& tree) const {
    if (!tree.openLeaves().empty()) return false;
    return !isMissing(tree.points());
  }

  // Whether a face of any of these points is.
  bool isMissing(const std::vector<glm::uvec3>& points) const {
    return std::any_of(points.begin(), points.end(), [&](const glm::uvec3& p) {
      for (std::uint32_t d = 0; d < 6; ++d)
        if (!present_.has({p.x, p.y, p.z, d})) return true;
      return false;
    });
  }

  // A context and a renderer of this thread's own, for what is judged.
  base::Result<void> start() {
    LUMIGRID_TRY(chooseLimits());
    LUMIGRID_ASSIGN_OR_RETURN(auto context, base::HeadlessContext::create());
    context_ = std::move(context);
    LUMIGRID_ASSIGN_OR_RETURN(auto renderer, SceneRenderer::create(scene_, patches_, limits_->gpu_budget_bytes));
    renderer_ = std::move(renderer);
    return {};
  }

  // One context on a GPU, and one where no command for others is given; software GL draws in as many processes as keep
  // the cores busy.
  base::Result<bool> needsProcesses() const {
    if (options_.draw_command.empty() || options_.threads == 1) return false;
    LUMIGRID_ASSIGN_OR_RETURN(const auto context, base::HeadlessContext::create());
    return context->isSoftware();
  }

  // Once, before the first context is made that is kept.
  base::Result<void> chooseLimits() {
    if (limits_) return {};
    LUMIGRID_ASSIGN_OR_RETURN(const auto in_processes, needsProcesses());
    const bool judges = options_.target_db > 0.0;
    const std::uint64_t faces = options_.grid.faceCount();
    const DrawDemand demand{patches_.hierarchy(),
                            options_.grid.face_size,
                            renderOptions(options_),
                            static_cast<std::uint32_t>(std::min<std::uint64_t>(options_.batch_faces, faces)),
                            std::min(windowOf(options_), faces),
                            faces / 8,
                            threadsOf(options_),
                            in_processes,
                            judges ? judgeBytes(faces, options_.grid.face_size, JudgeOptions().gpu_budget_bytes) : 0};
    LUMIGRID_ASSIGN_OR_RETURN(const auto limits, limitDrawing(demand, options_.memory_bytes));
    limits_ = limits;
    return {};
  }

  // What is missing at these points; gives those of them that were rendered and see nothing.
  base::Result<std::vector<glm::uvec3>> render(const std::vector<glm::uvec3>& points) {
    if (!isMissing(points)) return std::vector<glm::uvec3>();
    LUMIGRID_TRY(chooseLimits());
    Baker baker(scene_, patches_, store_, options_, *limits_, present_, points);
    LUMIGRID_TRY(baker.run(progress_));
    summary_.faces_rendered += baker.counters().done;
    summary_.faces_empty += baker.counters().empty;
    summary_.jpeg_bytes += baker.counters().jpeg_bytes;
    summary_.coverage_bytes += baker.counters().coverage_bytes;
    std::vector<glm::uvec3> blind;
    for (const glm::uvec3& p : points) {
      if (baker.emptyAt(p) == 6) blind.push_back(p);
      for (std::uint32_t d = 0; d < 6; ++d) present_.add({p.x, p.y, p.z, d});
    }
    present_.addBytes(baker.counters().value_bytes);
    return blind;
  }

  const base::Scene& scene_;
  const lod::patch::PatchFile& patches_;
  repository::Store& store_;
  const BakeOptions& options_;
  const std::function<bool(const BakeProgress&)>& progress_;
  const std::string parameters_;
  Present present_;
  BakeSummary summary_;
  std::optional<DrawLimits> limits_;  // how faces are drawn, once it is known
  std::unique_ptr<base::HeadlessContext> context_;
  std::unique_ptr<SceneRenderer> renderer_;  // goes before its context
};

}  // namespace

base::Result<void> checkBakeOptions(const BakeOptions& options) {
  const auto wrong = [](const std::string& what) {
    return base::Error{base::ErrorCode::kInvalidInput, "bake: " + what};
  };
  const repository::Grid& grid = options.grid;
  base::ByteWriter bytes;
  grid.encode(bytes);
  base::ByteReader reader(bytes.view());
  if (const auto sound = repository::Grid::decode(reader); !sound) return base::within("bake", sound.error());
  if (grid.pointCount() == 0) return wrong("a grid without points");
  if (grid.pointCount() > kMaxPoints)
    return wrong("a grid of " + std::to_string(grid.pointCount()) + " points; the most is " +
                 std::to_string(kMaxPoints) + ", take a coarser one");
  if (options.quality < 1 || options.quality > 100)
    return wrong("quality " + std::to_string(options.quality) + "; it must be 1 to 100");
  if (options.batch_faces < 1) return wrong("batches of no faces");
  if (!(options.target_db >= 0.0) || options.coarse_cells < 1)
    return wrong("a target below 0 dB, or no cells to begin with");
  if (options.shard.count < 1 || options.shard.index >= options.shard.count)
    return wrong("no shard " + std::to_string(options.shard.index) + " of " + std::to_string(options.shard.count));
  if (!(options.demand_worth > 0.0 && options.demand_worth <= 1.0))
    return wrong("a worth that is not above 0 and at most 1");
  if (options.target_db > 0.0 && options.demand_views > 0) return wrong("both a target and points by use");
  if (isAdaptive(options) && options.shard.count > 1)
    return wrong("adaptive sampling of a shard; where images are wanted shows on the way, so one store holds them all");
  return {};
}

RenderOptions renderOptions(const BakeOptions& options) {
  RenderOptions render;
  render.tolerance_px = options.tolerance_px;
  render.supersampling = options.supersampling;
  return render;
}

base::Result<BakeSummary> bake(const base::Scene& scene, const lod::patch::PatchFile& patches, repository::Store& store,
                               const BakeOptions& options, const std::function<bool(const BakeProgress&)>& progress) {
  const Clock::time_point start = Clock::now();
  LUMIGRID_TRY(checkBakeOptions(options));
  auto summary = Work(scene, patches, store, options, progress).run();
  if (summary) summary->seconds = secondsBetween(start, Clock::now());
  return summary;
}

}  // namespace server
