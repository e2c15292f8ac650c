#include "client/source/streamed_umbrellas.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/format_text.h"
#include "base/text.h"
#include "client/source/streamed_draw.h"

namespace client {
namespace {

/// Shares of the memory, sixteenths: chunks and decoded leaves, and the same leaves on the GPU. The rest is left to the
/// samples of the picture (client/viewer/memory_plan.h).
constexpr std::uint64_t kStreamShare = 7;
constexpr std::uint64_t kGpuShare = 5;

StreamedOptions checked(StreamedOptions options) {
  options.tolerance = std::max(options.tolerance, kMinTolerance);
  return options;
}

lod::pmr::StreamOptions umbrellaStreamOptions(const StreamedOptions& options) {
  lod::pmr::StreamOptions stream;
  stream.memory_bytes = std::max(options.memory_bytes / 16 * kStreamShare, lod::pmr::kMinStreamMemory);
  stream.decode_per_frame = options.decode_per_frame;
  return stream;
}

/// Returns whether the ray meets the box nearer than `nearest`.
bool meetsBox(const SceneRay& ray, const base::Aabb& box, double nearest) {
  double enter = 0.0;
  double leave = nearest;
  for (int axis = 0; axis < 3; ++axis) {
    double first = (static_cast<double>(box.min[axis]) - ray.origin[axis]) / ray.direction[axis];
    double second = (static_cast<double>(box.max[axis]) - ray.origin[axis]) / ray.direction[axis];
    if (first > second) std::swap(first, second);
    // A ray within a side's plane gives no number; the comparisons then leave the limits as they are.
    if (first > enter) enter = first;
    if (second < leave) leave = second;
  }
  return enter <= leave;
}

/// Returns the distance at which the ray meets the triangle, infinity where it does not (Möller and Trumbore 1997).
double distanceToTriangle(const SceneRay& ray, const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c) {
  constexpr double kMiss = std::numeric_limits<double>::infinity();
  const glm::dvec3 ab = b - a;
  const glm::dvec3 ac = c - a;
  const glm::dvec3 across = glm::cross(ray.direction, ac);
  const double determinant = glm::dot(ab, across);
  if (determinant == 0.0) return kMiss;
  const glm::dvec3 from_a = ray.origin - a;
  const double u = glm::dot(from_a, across) / determinant;
  const glm::dvec3 turned = glm::cross(from_a, ab);
  const double v = glm::dot(ray.direction, turned) / determinant;
  if (!(u >= 0.0 && v >= 0.0 && u + v <= 1.0)) return kMiss;
  const double along = glm::dot(ac, turned) / determinant;
  return along >= 0.0 ? along : kMiss;
}

/// Returns the distance at which the ray passes the point by at most `radius`, infinity where it does not.
double distanceToPoint(const SceneRay& ray, const glm::dvec3& point, double radius) {
  const glm::dvec3 to_point = point - ray.origin;
  const double along = glm::dot(to_point, ray.direction);
  const bool meets = along >= 0.0 && glm::dot(to_point, to_point) - along * along <= radius * radius;
  return meets ? along : std::numeric_limits<double>::infinity();
}

/// Returns the distance to the leaf's surface where that is nearer than `nearest`, else `nearest`. The triangles of
/// points count, too.
double distanceToLeaf(const SceneRay& ray, const lod::pmr::DrawnLeaf& leaf, const glm::vec4& section, double nearest) {
  const lod::pmr::LeafPicture& picture = *leaf.picture;
  const auto place = [&](std::uint16_t vertex) { return glm::dvec3(picture.vertices[vertex].position); };
  const auto keep = [&](double distance) {
    if (!(distance < nearest)) return;
    const glm::vec3 point(ray.origin + distance * ray.direction);
    if (glm::dot(glm::vec3(section), point) <= section.w) nearest = distance;
  };
  const std::vector<std::uint16_t>& corners = picture.list.corners;
  for (std::size_t i = 0; i + 2 < corners.size(); i += 3)
    keep(distanceToTriangle(ray, place(corners[i]), place(corners[i + 1]), place(corners[i + 2])));
  const lod::pmr::DrawnPart points = picture.list.pointsAt(leaf.pixel);
  for (std::uint32_t i = points.first; i < points.end; ++i)
    keep(distanceToPoint(ray, place(picture.list.points[i]), 0.5 * static_cast<double>(leaf.pixel)));
  return nearest;
}

}  // namespace

StreamedUmbrellas::StreamedUmbrellas(FilePlace file, const protocol::Welcome& welcome,
                                     std::unique_ptr<RangeFetcher> fetcher, const StreamedOptions& options)
    : file_(std::move(file), welcome, std::move(fetcher)),
      options_(checked(options)),
      stream_(file_.place().bytes, umbrellaStreamOptions(options)),
      pace_(options_.frame_seconds, options_.tolerance) {}

StreamedUmbrellas::StreamedUmbrellas(FilePlace file, const protocol::Welcome& welcome,
                                     std::shared_ptr<const lod::FileBytes> bytes, const StreamedOptions& options)
    : file_(std::move(file), welcome, nullptr),
      options_(checked(options)),
      stream_(std::move(bytes), umbrellaStreamOptions(options)),
      pace_(options_.frame_seconds, options_.tolerance) {}

const base::Sphere* StreamedUmbrellas::bounds() const {
  return stream_.header() != nullptr ? &stream_.header()->bounds : nullptr;
}

// ---- which leaves ----

void StreamedUmbrellas::update(const base::Camera& camera, const StreamedLook& look) {
  if (stream_.header() == nullptr) return;
  has_undrawn_ = false;
  const float tolerance = wantedTolerance();
  const bool same_view =
      chosen_ && base::sameCamera(camera, camera_) && look.section == section_ && tolerance == tolerance_;
  if (same_view && stream_.generation() == chosen_generation_ && !stream_.decoding()) return;
  if (same_view && moreIsComing() && !hasRested()) return;
  camera_ = camera;
  section_ = look.section;
  tolerance_ = tolerance;
  chosen_ = true;
  // A view that rests makes up for the frames in between, which are not drawn while requests are under way.
  choose(same_view && stream_.stats().requests > 0 ? 1 + DutyCycle::kRest : 1);
}

void StreamedUmbrellas::choose(std::uint32_t frames) {
  lod::pmr::TraverseRequest request;
  request.camera = camera_;
  request.tolerance = tolerance_;
  request.section = section_;
  chosen_generation_ = stream_.generation();
  stream_.update(request, leaves_, frames);
}

bool StreamedUmbrellas::pump(Session& session, double now) {
  const bool came = file_.pump(stream_, session, now);
  if (drawn_.hasPassed()) frames_.record(drawn_begin_, this->now());
  // Between the frames of a view that rests, what comes is decoded while the link goes on.
  if (came && chosen_ && !moved_ && moreIsComing() && !hasRested()) {
    choose(1);
    has_undrawn_ = true;
  }
  return came;
}

/// Whether requests are under way for a view that lacks something.
bool StreamedUmbrellas::moreIsComing() const {
  return !stream_.complete() && stream_.stats().under_way > 0;
}

/// Whether the last frame was so long ago that the next one may come before all requests are answered.
bool StreamedUmbrellas::hasRested() const {
  return !options_.clock || (!drawn_.isSet() && frames_.hasRested(now()));
}

// ---- drawing ----

base::Result<void> StreamedUmbrellas::draw(const base::Camera& camera, const StreamedLook& look) {
  const double begin = now();
  const bool moved = pace_.beginFrame(camera);
  update(camera, look);
  LUMIGRID_TRY(drawChosen(camera, look));
  moved_ = moved;
  drawn_.remove();
  if (stream_.header() == nullptr || !options_.clock) return {};
  if (moved && pace_.isOn()) {
    waitForGpu();
    const double end = now();
    frames_.record(begin, end);
    pace_.recordFrame(end - begin, count_.points + count_.triangles);
  } else if (moreIsComing()) {
    drawn_.set();
    drawn_begin_ = begin;
  }
  return {};
}

base::Result<void> StreamedUmbrellas::drawChosen(const base::Camera& camera, const StreamedLook& look) {
  clearPicture(look.background);
  const lod::pmr::Header* const header = stream_.header();
  if (header == nullptr) return {};
  if (!renderer_) {
    LUMIGRID_ASSIGN_OR_RETURN(renderer_, lod::draw::UmbrellaRenderer::create(options_.memory_bytes / 16 * kGpuShare));
  }
  GLint framebuffer = 0;
  glGetIntegerv(GL_FRAMEBUFFER_BINDING, &framebuffer);
  lod::draw::UmbrellaView view;
  view.camera = camera;
  view.shading = look.shading;
  view.section = look.section;
  view.oriented = header->oriented;
  view.resolution_colors = look.resolution_colors;
  LUMIGRID_ASSIGN_OR_RETURN(
      count_, renderer_->draw(leaves_, view, {static_cast<GLuint>(framebuffer), camera.width, camera.height}));
  return {};
}

std::optional<glm::vec3> StreamedUmbrellas::surfaceAt(const base::Camera& camera, const StreamedLook& look, double x,
                                                      double y) const {
  const SceneRay ray = rayThrough(camera, x, y);
  double nearest = std::numeric_limits<double>::infinity();
  for (const lod::pmr::DrawnLeaf& leaf : leaves_)
    if (meetsBox(ray, stream_.leaves()[leaf.picture->leaf].box, nearest))
      nearest = distanceToLeaf(ray, leaf, look.section, nearest);
  if (!std::isfinite(nearest)) return std::nullopt;
  return glm::vec3(ray.origin + nearest * ray.direction);
}

void StreamedUmbrellas::setQuality(const StreamedQuality& quality) {
  static_cast<StreamedQuality&>(options_) = quality;
  options_ = checked(options_);
  pace_.setGoal(options_.frame_seconds, options_.tolerance);
}

// ---- figures ----

bool StreamedUmbrellas::complete() const {
  return chosen_ && !has_undrawn_ && stream_.complete() && chosen_generation_ == stream_.generation() &&
         tolerance_ <= options_.tolerance;
}

bool StreamedUmbrellas::busy() const {
  if (!chosen_ || tolerance_ > options_.tolerance) return chosen_;
  if (!has_undrawn_ && !stream_.decoding() && chosen_generation_ == stream_.generation()) return false;
  return !moreIsComing() || hasRested();
}

std::vector<StatisticsLine> describeUmbrellas(const StreamedStats& s) {
  const UmbrellaStats& umbrellas = s.umbrellas;
  const auto count = [](std::uint64_t value) { return base::formatCount(value, ' '); };
  return {
      {"umbrellas", count(umbrellas.triangles) + " triangles, " + count(umbrellas.points) + " points" +
                        base::formatText(", of %.1f px", static_cast<double>(s.error_px))},
      {"leaves", count(umbrellas.leaves) + " in view, " + count(umbrellas.stream.present) + " of " +
                     count(umbrellas.stream.leaves) + " here, " + count(umbrellas.stream.lacking) + " to be refined"}};
}

StreamedStats StreamedUmbrellas::stats() const {
  StreamedStats stats;
  stats.drawn = count_.points + count_.triangles;
  stats.error_px = tolerance_;
  stats.finest_px = options_.tolerance;
  stats.limited = stream_.limitedByMemory();
  stats.buffer_bytes = renderer_ ? renderer_->gpuBytes() : 0;
  const lod::pmr::StreamStats stream = stream_.stats();
  stats.file_bytes = stream.memory_bytes;
  stats.bytes_received = stream.bytes_received;
  stats.requests = stream.requests;
  stats.present = stream.present;
  stats.lacking = stream.lacking;
  stats.broken = static_cast<std::uint32_t>(stream.damaged);
  stats.warning = stream_.warning();
  stats.describe = describeUmbrellas;
  stats.umbrellas = {count_.points, count_.triangles, leaves_.size(), stream};
  return stats;
}

}  // namespace client
