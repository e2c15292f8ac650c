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

#include "base/parallel.h"
#include "repository/face_value.h"
#include "server/bake/committer.h"
#include "server/bake/draw_pool.h"
#include "server/bake/face_encoder.h"

// Stages, each on its own threads: dealing out grid points (this thread), drawing and reading back (DrawPool), encoding
// (a pool), committing (the Committer's thread). Queues between them are bounded, so a slow disk slows the drawing down
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
       << "\"\n}\n";
  return text.str();
}

// "quality": 85 against "quality": 90, from the first line that differs.
std::string firstDifference(const std::string& stored, const std::string& wanted) {
  std::istringstream a(stored);
  std::istringstream b(wanted);
  std::string line_a;
  std::string line_b;
  while (std::getline(a, line_a) && std::getline(b, line_b)) {
    for (std::string* line : {&line_a, &line_b}) {
      if (line->ends_with(',')) line->pop_back();
    }
    if (line_a != line_b) return line_a + ", now " + line_b;
  }
  return "other parameters";
}

base::Result<void> claimStore(repository::Store& store, const std::string& wanted) {
  const auto other = [](const std::string& what) {
    return base::Error{base::ErrorCode::kExists, "the image repository was built with " + what +
                                                     "; give the same options, or --force to build it anew"};
  };
  auto stored = store.readMeta();
  if (!stored) return stored.error();
  if (*stored)
    return **stored == wanted ? base::Result<void>() : base::Result<void>(other(firstDifference(**stored, wanted)));
  auto size = store.size();
  if (!size) return size.error();
  if (*size > 0) return other("unknown parameters");
  return store.writeMeta(wanted);
}

// --- What is there already
// -----------------------------------------------------------------------------------------------------

// One bit a face of the grid: its value is in the store and whole.
class Present {
 public:
  explicit Present(const repository::Grid& grid) : grid_(grid), bits_(grid.faceCount(), false) {}

  base::Result<void> read(const repository::Store& store) {
    return store.forEach([&](const repository::FaceKey& key, base::ByteView value) {
      if (!grid_.contains(key) || !repository::decodeFaceValue(value)) return true;
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
  std::size_t index(const repository::FaceKey& key) const {
    return static_cast<std::size_t>(((std::uint64_t{key.z} * grid_.count.y + key.y) * grid_.count.x + key.x) * 6 +
                                    key.d);
  }
  const repository::Grid& grid_;
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
  Baker(const base::Scene& scene, const lod::patch::PatchFile& patches, repository::Store& store,
        const BakeOptions& options, unsigned drawing_threads, const Present& present)
      : options_(options),
        present_(present),
        threads_(options.threads == 0 ? base::coreCount() : options.threads),
        committer_(store, options.batch_faces, 2 * std::uint64_t{options.batch_faces} + 8 * threads_),
        encoders_(threads_, 2 * threads_),
        draw_(
            scene, patches, options_.grid, renderOptions(options), drawing_threads,
            [this](std::uint64_t sequence, const repository::FaceKey& key, Rendered rendered) {
              take(sequence, key, std::move(rendered));
            },
            [this](const base::Error& error) { committer_.fail(error); }) {}

  base::Result<void> run(const std::function<bool(const BakeProgress&)>& progress) {
    bool cancelled = !progress(progressNow());
    std::uint64_t sequence = 0;
    for (const glm::uvec3& point : repository::pointsInMortonOrder(options_.grid)) {
      if (cancelled) break;
      DrawJob job{sequence, missingAt(point)};
      if (job.keys.empty()) continue;
      sequence += job.keys.size();
      if (!committer_.waitForRoom(sequence - 1)) break;
      draw_.submit(std::move(job));
      cancelled = !progress(progressNow());
    }

    // What is drawn is kept, also after a cancellation.
    draw_.finish();
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

  // A picture has come back.
  void take(std::uint64_t sequence, const repository::FaceKey& key, Rendered rendered) {
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
    now.faces_total = options_.grid.faceCount();
    now.stored_bytes = present_.bytes() + counters_.value_bytes;
    now.faces_per_second = rate_.update(Clock::now(), now.faces_done);
    const auto left = static_cast<double>(now.faces_total - now.faces_skipped - now.faces_done);
    now.seconds_left = now.faces_per_second > 0.0 ? left / now.faces_per_second : 0.0;
    return now;
  }

  const BakeOptions& options_;
  const Present& present_;
  const unsigned threads_;
  Counters counters_;
  MovingRate rate_;
  Committer committer_;
  base::ThreadPool encoders_;  // its jobs use the others, so it ends before them
  DrawPool draw_;              // … and this one before it
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
  LUMIGRID_TRY(claimStore(store, parametersText(scene, options)));
  Present present(options.grid);
  LUMIGRID_TRY(present.read(store));

  BakeSummary summary;
  summary.faces_skipped = present.count();
  if (present.count() < options.grid.faceCount()) {
    const auto drawing_threads = DrawPool::threadsFor(options.threads == 0 ? base::coreCount() : options.threads);
    if (!drawing_threads) return drawing_threads.error();
    Baker baker(scene, patches, store, options, *drawing_threads, present);
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
