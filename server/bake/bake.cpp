#include "server/bake/bake.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <deque>
#include <memory>
#include <sstream>
#include <utility>
#include <vector>

#include "base/egl/headless.h"
#include "base/parallel.h"
#include "repository/cube_face.h"
#include "repository/face_value.h"
#include "repository/parameters.h"
#include "server/bake/committer.h"
#include "server/bake/face_encoder.h"
#include "server/render/scene_renderer.h"

// Four stages, each on its own threads: drawing and reading back (this thread, which has the GL context), encoding (a
// pool), committing (the Committer's thread). Queues between them are bounded, so a slow disk slows the drawing down
// and memory stays small.

namespace server {
namespace {

constexpr std::uint64_t kMaxPoints = std::uint64_t{1} << 26;
constexpr double kRateSeconds = 15.0;  // the rate shown is that of so long

using Clock = std::chrono::steady_clock;
double secondsBetween(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

// --- The store's parameters
// ----------------------------------------------------------------------------------------------------

const char* nameOf(repository::Subsampling subsampling) {
  switch (subsampling) {
    case repository::Subsampling::k420:
      return "4:2:0";
    case repository::Subsampling::k422:
      return "4:2:2";
    case repository::Subsampling::k444:
      return "4:4:4";
  }
  return "";
}

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
       << nameOf(options.subsampling) << "\""
       << ",\n\"tolerance\": " << number(options.tolerance_px) << ",\n\"supersampling\": " << options.supersampling
       << ",\n\"light\": \"" << (scene.light.mode == base::LightMode::kUnlit ? "unlit" : "soft") << "\""
       << ",\n\"light direction\": " << numbers(scene.light.direction) << ",\n\"patch.lgp\": \"" << patch_sha256
       << "\"\n}\n";
  return text.str();
}

base::Result<void> claimStore(repository::Store& store, const std::string& wanted) {
  const auto other = [](const std::string& what) {
    return base::Error{base::ErrorCode::kExists, "the image repository was built with " + what +
                                                     "; give the same options, or --force to build it anew"};
  };
  auto stored = store.readMeta();
  if (!stored) return stored.error();
  if (*stored)
    return **stored == wanted ? base::Result<void>()
                              : base::Result<void>(other(repository::firstDifference(**stored, wanted)));
  auto size = store.size();
  if (!size) return size.error();
  if (*size > 0) return other("unknown parameters");
  return store.writeMeta(wanted);
}

base::Result<void> checkOptions(const BakeOptions& options) {
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
  if (options.shard.count < 1 || options.shard.index >= options.shard.count)
    return wrong("no shard " + std::to_string(options.shard.index) + " of " + std::to_string(options.shard.count));
  return {};
}

std::uint64_t faceCountOf(const BakeOptions& options) {
  return 6 * repository::pointsOf(options.shard, options.grid).size();
}

// --- What is there already
// -----------------------------------------------------------------------------------------------------

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

// --- Counting
// ------------------------------------------------------------------------------------------------------------------

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

// --- The work
// ------------------------------------------------------------------------------------------------------------------

class Baker {
 public:
  Baker(SceneRenderer& renderer, repository::Store& store, const BakeOptions& options, const Present& present)
      : renderer_(renderer),
        options_(options),
        present_(present),
        threads_(options.threads == 0 ? base::coreCount() : options.threads),
        committer_(store, options.batch_faces, 2 * std::uint64_t{options.batch_faces} + 8 * threads_),
        encoders_(threads_, 2 * threads_) {}

  base::Result<void> run(const std::function<bool(const BakeProgress&)>& progress) {
    bool cancelled = !progress(progressNow());
    const repository::PointRange points = repository::pointsOf(options_.shard, options_.grid);
    for (std::uint64_t rank = points.first; rank < points.end; ++rank) {
      if (cancelled || committer_.failed()) break;
      const auto keys = missingAt(repository::pointAtMortonRank(options_.grid, rank));
      if (keys.empty()) continue;
      if (auto drawn = draw(keys); !drawn) committer_.fail(drawn.error());
      cancelled = !progress(progressNow());
    }

    // What is drawn is kept, also after a cancellation.
    if (auto finished = renderer_.finish(); !finished) committer_.fail(finished.error());
    encoders_.drain();
    LUMIGRID_TRY(committer_.finish());
    if (cancelled)
      return base::Error{base::ErrorCode::kCancelled, "stopped; the same command goes on where it stopped"};
    progress(progressNow());
    return {};
  }
  const Counters& counters() const { return counters_; }

 private:
  std::vector<repository::FaceKey> missingAt(const glm::uvec3& point) const {
    std::vector<repository::FaceKey> keys;
    for (std::uint32_t d = 0; d < 6; ++d) {
      const repository::FaceKey key{point.x, point.y, point.z, d};
      if (!present_.has(key)) keys.push_back(key);
    }
    return keys;
  }

  base::Result<void> draw(const std::vector<repository::FaceKey>& keys) {
    const repository::FaceKey& key = keys.front();
    const base::DepthRange depth =
        base::depthRangeFor(options_.grid.point(key.x, key.y, key.z), renderer_.sceneCenter(), renderer_.sceneRadius());
    std::vector<base::Camera> cameras;
    for (const repository::FaceKey& one : keys)
      cameras.push_back(repository::faceCamera(options_.grid, one, depth.near_plane, depth.far_plane));
    RenderOptions render;
    render.tolerance_px = options_.tolerance_px;
    render.supersampling = options_.supersampling;
    return renderer_.renderMany(cameras, render,
                                [this, keys](std::size_t i, Rendered rendered) { take(keys[i], std::move(rendered)); });
  }

  // A picture has come back, in the order drawn.
  void take(const repository::FaceKey& key, Rendered rendered) {
    const std::uint64_t sequence = taken_++;
    if (!committer_.waitForRoom(sequence)) return;
    auto picture = std::make_shared<base::Image>(std::move(rendered.rgba));
    encoders_.submit([this, sequence, key, picture] {
      auto face = encodeFace(*picture, options_.quality, options_.subsampling);
      if (!face) return committer_.fail(face.error());
      counters_.add(*face);
      committer_.deliver(sequence, key, std::move(face->value));
    });
  }

  BakeProgress progressNow() {
    BakeProgress now;
    now.faces_done = counters_.done;
    now.faces_skipped = present_.count();
    now.faces_total = faceCountOf(options_);
    now.stored_bytes = present_.bytes() + counters_.value_bytes;
    now.faces_per_second = rate_.update(Clock::now(), now.faces_done);
    const auto left = static_cast<double>(now.faces_total - now.faces_skipped - now.faces_done);
    now.seconds_left = now.faces_per_second > 0.0 ? left / now.faces_per_second : 0.0;
    return now;
  }

  SceneRenderer& renderer_;
  const BakeOptions& options_;
  const Present& present_;
  const unsigned threads_;
  std::uint64_t taken_ = 0;
  Counters counters_;
  MovingRate rate_;
  Committer committer_;
  base::ThreadPool encoders_;  // last: its jobs use the others, and it ends first
};

}  // namespace

base::Result<BakeSummary> bake(const base::Scene& scene, const lod::patch::PatchFile& patches, repository::Store& store,
                               const BakeOptions& options, const std::function<bool(const BakeProgress&)>& progress) {
  const Clock::time_point start = Clock::now();
  LUMIGRID_TRY(checkOptions(options));
  LUMIGRID_TRY(claimStore(store, parametersText(scene, options)));
  Present present(options.grid, options.shard);
  LUMIGRID_TRY(present.read(store));

  BakeSummary summary;
  summary.faces_skipped = present.count();
  if (present.count() < faceCountOf(options)) {
    auto context = base::HeadlessContext::create();
    if (!context) return context.error();
    auto renderer = SceneRenderer::create(scene, patches);
    if (!renderer) return renderer.error();
    Baker baker(**renderer, store, options, present);
    LUMIGRID_TRY(baker.run(progress));
    summary.faces_rendered = baker.counters().done;
    summary.faces_empty = baker.counters().empty;
    summary.jpeg_bytes = baker.counters().jpeg_bytes;
    summary.coverage_bytes = baker.counters().coverage_bytes;
  }
  summary.seconds = secondsBetween(start, Clock::now());
  return summary;
}

}  // namespace server
