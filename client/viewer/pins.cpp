#include "client/viewer/pins.h"

#include <algorithm>
#include <utility>

#include "client/viewer/shaders.h"

namespace client {
namespace {

constexpr std::size_t kMaxQueriesPerFrame = 128;  ///< a query costs a browser some microseconds of calls
/// A pin lies on the true surface, but the picture shows a proxy. The pin is lifted towards the viewer by 1.5 times the
/// proxy's error bound, and by 2 pixels for the rounding of depth on slanted surfaces. Both are choices: more lets pins
/// shine through thin walls, less hides pins that stand on the surface.
constexpr float kLiftErrors = 1.5F;
constexpr float kLiftPixels = 2.0F;
constexpr float kNearest = 0.9999F;  ///< just behind the near plane, in normalized device coordinates

}  // namespace

base::Result<PinProbe> PinProbe::create() {
  LUMIGRID_ASSIGN_OR_RETURN(auto program, base::gl::Program::link("pins", glsl::kPinVertex, glsl::kPinFragment));
  return PinProbe(std::move(program));
}
PinProbe::PinProbe(base::gl::Program program)
    : program_(std::move(program)), no_attributes_(base::gl::VertexArray::create()) {}

void PinProbe::setPoints(std::vector<glm::vec3> points) {
  points_ = std::move(points);
  visible_.assign(points_.size(), false);
  for (PendingQuery& asked : in_flight_)
    asked.point = points_.size();  // an index behind the last one marks an answer that belongs to no point
  invalidate();
}

void PinProbe::invalidate() {
  wanted_ = points_.size();
  if (next_ >= points_.size()) next_ = 0;
}

void PinProbe::startQuery(std::size_t point, const glm::vec4& clip) {
  base::gl::Query query;
  if (spare_.empty()) {
    query = base::gl::Query::create();
  } else {
    query = std::move(spare_.back());
    spare_.pop_back();
  }
  glUniform4f(program_.uniform("u_clip"), clip.x, clip.y, clip.z, clip.w);
  glBeginQuery(GL_ANY_SAMPLES_PASSED, query.name());
  glDrawArrays(GL_POINTS, 0, 1);
  glEndQuery(GL_ANY_SAMPLES_PASSED);
  in_flight_.push_back({point, std::move(query)});
}

void PinProbe::draw(const base::Camera& camera, float error_px) {
  const glm::vec4& section = camera.section;
  if (wanted_ == 0 || !in_flight_.empty()) return;
  const glm::mat4 clip_from_scene = camera.clipFromScene();
  program_.use();
  glBindVertexArray(no_attributes_.name());
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_LEQUAL);
  glDepthMask(GL_FALSE);
  glColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
  for (std::size_t i = 0; i < std::min(kMaxQueriesPerFrame, points_.size()) && wanted_ > 0; ++i) {
    const glm::vec3& point = points_[next_];
    const glm::vec3 to_viewer = camera.towardsViewer(point);
    const float lift = (kLiftErrors * error_px + kLiftPixels) / camera.pixelsPerUnit(point);
    const float length = glm::length(to_viewer);
    const bool cut_away = glm::dot(glm::vec3(section), point) > section.w + lift;
    glm::vec4 clip = clip_from_scene * glm::vec4(point + to_viewer * (lift / std::max(length, 1e-30F)), 1.0F);
    // The near plane lies just before what is drawn, and a lifted pin may lie before it.
    clip.z = std::max(clip.z, -kNearest * clip.w);
    if (cut_away || !(length > 0.0F))
      visible_[next_] = false;
    else
      startQuery(next_, clip);
    next_ = (next_ + 1) % points_.size();
    --wanted_;
  }
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glDepthMask(GL_TRUE);
  glDepthFunc(GL_LESS);
  glBindVertexArray(0);
}

void PinProbe::poll() {
  // Queries are answered in the order in which they were issued, so the first pending one ends the search.
  std::size_t answered = 0;
  for (; answered < in_flight_.size(); ++answered) {
    PendingQuery& asked = in_flight_[answered];
    GLuint available = GL_FALSE;
    glGetQueryObjectuiv(asked.query.name(), GL_QUERY_RESULT_AVAILABLE, &available);
    if (available == GL_FALSE) break;
    GLuint passed = GL_FALSE;
    glGetQueryObjectuiv(asked.query.name(), GL_QUERY_RESULT, &passed);
    if (asked.point < visible_.size()) visible_[asked.point] = passed != GL_FALSE;
    spare_.push_back(std::move(asked.query));
  }
  in_flight_.erase(in_flight_.begin(), in_flight_.begin() + static_cast<std::ptrdiff_t>(answered));
}

}  // namespace client
