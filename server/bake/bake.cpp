#include "server/bake/bake.h"

#include <algorithm>
#include <chrono>
#include <deque>
#include <memory>
#include <mutex>
#include <sstream>
#include <utility>
#include <vector>

#include "base/egl/headless.h"
#include "base/format_text.h"
#include "repository/faces/face_value.h"
#include "repository/sampling/expected_points.h"
#include "repository/sampling/face_tiles.h"
#include "repository/sampling/parameters.h"
#include "server/bake/committer.h"
#include "server/bake/draw_memory.h"
#include "server/bake/draw_processes.h"
#include "server/bake/face_maker.h"
#include "server/bake/face_sample.h"

// The stages run on threads or in processes of their own: this thread deals out grid points, a FaceMaker draws, reads
// back and encodes, and the Committer's thread commits. The queues between them are bounded, so a slow disk slows the
// drawing down and memory stays small.

namespace server {
namespace {

constexpr std::uint64_t kMaxPoints = std::uint64_t{1} << 26;  // StoredFaces takes 50 MB then
// 1024 × 1024, 8 MB. A tiled face as a whole has 16 times as many, which are cleared, drawn and averaged in memory, and
// most of its tiles show nothing.
constexpr std::uint64_t kTileSamples = std::uint64_t{1} << 20;
constexpr double kRateSeconds = 15.0;  // time that the shown rate is averaged over

using Clock = std::chrono::steady_clock;
double secondsBetween(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

// Knows which faces of the grid are whole in the store: one bit each.
class StoredFaces {
 public:
  StoredFaces(const repository::Grid& grid, const repository::ExpectedPoints& points)
      : grid_(grid), points_(points), bits_(grid.faceCount(), false) {}

  /// Faces of other points are passed over. The keys of a face's tiles follow each other.
  base::Result<void> read(const repository::Store& store) {
    std::optional<OpenFace> face;
    LUMIGRID_TRY(store.forEach([&](const repository::FaceKey& key, base::ByteView value) {
      if (!isExpected(key)) return true;
      if (!face || face->key != key.face()) {
        close(face);
        face.emplace();
        face->key = key.face();
      }
      addTile(*face, key.tile, value);
      return true;
    }));
    close(face);
    return {};
  }
  bool has(const repository::FaceKey& key) const { return bits_[index(key)]; }
  std::uint64_t count() const { return count_; }
  std::uint64_t bytes() const { return bytes_; }

 private:
  /// A face whose tiles are being read.
  struct OpenFace {
    repository::FaceKey key;
    repository::FaceTiles tiles;
    bool sound = true;
    std::uint64_t bytes = 0;
  };
  static void addTile(OpenFace& face, std::uint32_t tile, base::ByteView bytes) {
    const auto value = repository::decodeFaceValue(bytes);
    if (value)
      face.tiles.add(tile, value->children);
    else
      face.sound = false;
    face.bytes += bytes.size();
  }
  void close(const std::optional<OpenFace>& face) {
    if (!face || !face->sound || !face->tiles.isWhole()) return;
    bits_[index(face->key)] = true;
    ++count_;
    bytes_ += face->bytes;
  }
  bool isExpected(const repository::FaceKey& key) const {
    return grid_.contains(key) && points_.placeOf({key.x, key.y, key.z}).has_value();
  }
  std::size_t index(const repository::FaceKey& key) const {
    return static_cast<std::size_t>(((std::uint64_t{key.z} * grid_.count.y + key.y) * grid_.count.x + key.x) * 6 +
                                    key.d);
  }
  const repository::Grid& grid_;
  const repository::ExpectedPoints& points_;
  std::vector<bool> bits_;
  std::uint64_t count_ = 0;
  std::uint64_t bytes_ = 0;
};

// Faces come from several threads.
class FaceCounters {
 public:
  void add(const EncodedFace& face) {
    const std::lock_guard lock(mutex_);
    ++sums_.faces_rendered;
    sums_.faces_empty += face.empty ? 1 : 0;
    sums_.jpeg_bytes += face.jpeg_bytes;
    sums_.coverage_bytes += face.coverage_bytes;
    for (const EncodedTile& tile : face.tiles) {
      TileCount& count = sums_.by_depth[repository::placeOfTile(tile.tile).depth];
      ++count.tiles;
      count.bytes += tile.value.size();
    }
    value_bytes_ += face.valueBytes();
  }
  /// Counts of faces and bytes; the rest is not known here.
  BakeSummary sums() const {
    const std::lock_guard lock(mutex_);
    return sums_;
  }
  std::uint64_t valueBytes() const {
    const std::lock_guard lock(mutex_);
    return value_bytes_;
  }

 private:
  mutable std::mutex mutex_;
  BakeSummary sums_;
  std::uint64_t value_bytes_ = 0;
};

// Faces a second over the last kRateSeconds.
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

/// Faces that may be under way at a time.
std::uint64_t windowOf(const BakeOptions& options) {
  return 2 * std::uint64_t{facesPerCommit(options)} + 16 * threadsOf(options);
}

// One context on a GPU, and one where no command for others is given; software GL draws in as many processes as keep
// the cores busy.
base::Result<bool> needsProcesses(const BakeOptions& options) {
  if (options.draw_command.empty() || options.limits.threads == 1) return false;
  LUMIGRID_ASSIGN_OR_RETURN(const auto context, base::HeadlessContext::create());
  return context->isSoftware();
}

// To be called before the first context is made that is kept.
base::Result<DrawLimits> drawLimits(const base::Scene& scene, const lod::patch::PatchFile& patches,
                                    const BakeOptions& options) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto in_processes, needsProcesses(options));
  const std::uint64_t faces = options.grid.faceCount();
  const DrawDemand demand{patches.hierarchy(),
                          drawnSide(options.grid),
                          renderOptions(options),
                          static_cast<std::uint32_t>(std::min<std::uint64_t>(facesPerCommit(options), faces)),
                          std::min(windowOf(options), faces),
                          faces / 8,
                          threadsOf(options),
                          in_processes,
                          PatchShadows::memoryFor(scene.light, scene.triangles)};
  return limitDrawing(demand, options.limits.resolved().memory_bytes);
}

// Deals out the points of which faces are missing, in Morton order, and brings their faces into the store.
class FaceBake {
 public:
  FaceBake(const base::Scene& scene, const lod::patch::PatchFile& patches, repository::Store& store,
           const BakeOptions& options, const DrawLimits& limits, const repository::ExpectedPoints& points,
           const StoredFaces& stored)
      : options_(options),
        points_(points),
        stored_(stored),
        committer_(store, facesPerCommit(options), windowOf(options)),
        faces_(makeFaces({scene, patches, options.grid, renderOptions(options), options.quality, options.subsampling,
                          limits.gpu_budget_bytes, options.codec, options.tiles ? &*options.tiles : nullptr},
                         limits)) {}

  base::Result<void> run(const std::function<bool(const BakeProgress&)>& progress) {
    bool cancelled = !progress(progressNow());
    std::uint64_t sequence = 0;
    for (std::uint64_t place = 0; place < points_.size() && !cancelled; ++place) {
      DrawJob job{sequence, missingAt(points_.at(place))};
      if (job.keys.empty()) continue;
      sequence += job.keys.size();
      if (!committer_.waitForRoom(sequence - 1)) break;
      faces_->submit(std::move(job));
      cancelled = !progress(progressNow());
    }

    // Faces that are drawn are kept, also after a cancellation.
    faces_->finish();
    LUMIGRID_TRY(committer_.finish());
    if (cancelled)
      return base::Error{base::ErrorCode::kCancelled, "stopped; the same command goes on where it stopped"};
    progress(progressNow());
    return {};
  }
  const FaceCounters& counters() const { return counters_; }

 private:
  std::vector<repository::FaceKey> missingAt(const glm::uvec3& point) const {
    std::vector<repository::FaceKey> keys;
    for (std::uint32_t d = 0; d < 6; ++d) {
      const repository::FaceKey key{point.x, point.y, point.z, d};
      if (!stored_.has(key)) keys.push_back(key);
    }
    return keys;
  }

  std::unique_ptr<FaceMaker> makeFaces(const FaceWork& work, const DrawLimits& limits) {
    FaceMaker::OnFace on_face = [this](std::uint64_t sequence, const repository::FaceKey& key, EncodedFace face) {
      counters_.add(face);
      committer_.deliver(sequence, key, std::move(face.tiles));
    };
    FaceMaker::OnError on_error = [this](const base::Error& error) { committer_.fail(error); };
    if (limits.processes == 0)
      return makeLocalFaceMaker(work, limits.encoders, std::move(on_face), std::move(on_error));
    const auto processes = std::min<std::uint64_t>(limits.processes, points_.size());
    return makeProcessFaceMaker(work, options_.draw_command, static_cast<unsigned>(processes), std::move(on_face),
                                std::move(on_error));
  }

  BakeProgress progressNow() {
    BakeProgress now;
    now.faces_done = counters_.sums().faces_rendered;
    now.faces_skipped = stored_.count();
    now.faces_total = 6 * points_.size();
    now.stored_bytes = stored_.bytes() + counters_.valueBytes();
    now.faces_per_second = rate_.update(Clock::now(), now.faces_done);
    return now;
  }

  const BakeOptions& options_;
  const repository::ExpectedPoints& points_;
  const StoredFaces& stored_;
  FaceCounters counters_;
  MovingRate rate_;
  Committer committer_;
  std::unique_ptr<FaceMaker> faces_;  // last: it uses the others
};

// Nine digits bring a float back exactly.
std::string number(float v) {
  return base::formatText("%.9g", static_cast<double>(v));
}

std::string numbers(const glm::vec3& v) {
  return "[" + number(v.x) + ", " + number(v.y) + ", " + number(v.z) + "]";
}

/// The light, and with shadows where it is and what throws them.
std::string lightText(const base::Scene& scene) {
  const base::Light& light = scene.light;
  std::ostringstream text;
  text << ",\n\"light\": \"" << base::nameOf(light.mode) << "\",\n\"light direction\": " << numbers(light.direction);
  if (light.position)
    text << base::formatText(",\n\"light position\": [%.17g, %.17g, %.17g]", light.position->x, light.position->y,
                             light.position->z);
  if (light.size > 0.0) text << base::formatText(",\n\"light size\": %.17g", light.size);
  const auto casters = light.hasShadows() ? base::partFile(scene, "hlod", ".lgh") : std::nullopt;
  for (const base::ScenePart& part : scene.parts)
    if (part.file == casters) text << ",\n\"hlod.lgh\": \"" << part.sha256 << "\"";
  return text.str();
}

std::string selectionText(const PointSelection& selection) {
  if (selection.views == 0) return "";
  std::ostringstream text;
  text << ",\n\"demand views\": " << selection.views
       << ",\n\"demand worth\": " << number(static_cast<float>(selection.worth));
  if (selection.budget_bytes != 0) text << ",\n\"budget\": " << selection.budget_bytes;
  if (selection.by_viewers) text << ",\n\"demand by viewers\": true";
  return text.str();
}

}  // namespace

std::uint32_t facesPerCommit(const BakeOptions& options) {
  // Faces of tiles have 496 pixels a side at depth 1, and twice as many at each further one.
  const std::uint32_t depth = std::max(options.grid.tile_depth, 1U);
  return std::max(options.batch_faces >> (2 * (depth - 1)), 1U);
}

base::Result<void> checkBakeOptions(const BakeOptions& options) {
  const auto wrong = [](const std::string& problem) {
    return base::Error{base::ErrorCode::kInvalidInput, "bake: " + problem};
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
  if (options.shard.count < 1 || options.shard.index >= options.shard.count)
    return wrong("no shard " + std::to_string(options.shard.index) + " of " + std::to_string(options.shard.count));
  if (!(options.selection.worth > 0.0 && options.selection.worth <= 1.0))
    return wrong("a worth that is not above 0 and at most 1");
  if (options.selection.views > 0 && !options.points) return wrong("sampling by use without selected points");
  if (options.tiles && !(options.points && grid.isTiled()))
    return wrong("tiles that were selected go with selected points and a grid of tiles");
  return {};
}

RenderOptions renderOptions(const BakeOptions& options) {
  RenderOptions render;
  render.tolerance_px = options.tolerance_px;
  render.supersampling = options.supersampling;
  render.tile_samples = kTileSamples;
  render.one_of_many = true;
  return render;
}

std::string codingText(const BakeOptions& options) {
  const auto line = [](const char* name, const char* value) {
    return std::string(",\n\"") + name + "\": \"" + value + "\"";
  };
  return options.codec == repository::ImageCodec::kJpeg ? line("subsampling", base::nameOf(options.subsampling))
                                                        : line("codec", repository::nameOf(options.codec));
}

std::string storeParameters(const base::Scene& scene, const BakeOptions& options) {
  const repository::Grid& grid = options.grid;
  std::string patch_sha256;
  for (const base::ScenePart& part : scene.parts)
    if (part.file == "patch.lgp") patch_sha256 = part.sha256;
  std::ostringstream text;
  text << "{\n\"version\": 2"
       << ",\n\"grid\": {\"first\": " << numbers(grid.first) << ", \"spacing\": " << number(grid.spacing)
       << ", \"count\": [" << grid.count.x << ", " << grid.count.y << ", " << grid.count.z << "]"
       << ", \"face_size\": " << grid.face_size;
  if (grid.isTiled()) text << ", \"tile_depth\": " << grid.tile_depth;
  text << "},\n\"quality\": " << options.quality << codingText(options)
       << ",\n\"tolerance\": " << number(options.tolerance_px) << ",\n\"supersampling\": " << options.supersampling
       << lightText(scene) << ",\n\"patch.lgp\": \"" << patch_sha256 << "\"" << selectionText(options.selection)
       << "\n}\n";
  if (!options.points) return text.str();
  const std::string with_points = repository::withTree(text.str(), *options.points);
  return options.tiles ? repository::withTiles(with_points, grid, *options.tiles) : with_points;
}

base::Result<void> claimStore(repository::Store& store, const std::string& parameters) {
  const auto builtWith = [](const std::string& difference) {
    return base::Error{base::ErrorCode::kExists, "the image repository was built with " + difference +
                                                     "; give the same options, or --force to build it anew"};
  };
  LUMIGRID_ASSIGN_OR_RETURN(const auto stored, store.readMeta());
  if (stored && *stored != parameters) return builtWith(repository::firstDifference(*stored, parameters));
  if (stored) return {};
  LUMIGRID_ASSIGN_OR_RETURN(const auto size, store.size());
  if (size > 0) return builtWith("unknown parameters");
  return store.writeMeta(parameters);
}

base::Result<BakeSummary> bake(const base::Scene& scene, const lod::patch::PatchFile& patches, repository::Store& store,
                               const BakeOptions& options, const std::function<bool(const BakeProgress&)>& progress) {
  const Clock::time_point start = Clock::now();
  LUMIGRID_TRY(checkBakeOptions(options));
  LUMIGRID_TRY(claimStore(store, storeParameters(scene, options)));
  const repository::ExpectedPoints points(options.grid, options.shard, options.points ? &*options.points : nullptr);
  StoredFaces stored(options.grid, points);
  LUMIGRID_TRY(stored.read(store));
  BakeSummary summary;
  if (stored.count() < 6 * points.size()) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto limits, drawLimits(scene, patches, options));
    FaceBake faces(scene, patches, store, options, limits, points, stored);
    LUMIGRID_TRY(faces.run(progress));
    summary = faces.counters().sums();
  }
  summary.points = points.size();
  summary.faces_skipped = stored.count();
  summary.seconds = secondsBetween(start, Clock::now());
  return summary;
}

}  // namespace server
