#pragma once
// Finds out which world points are visible and which lie behind the drawn surface: one occlusion query for each,
// against the depth of the frame that was just drawn. This needs no extra pass over the geometry, reads nothing back
// and never waits.
#include <glm/glm.hpp>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/gl/gl.h"

namespace client {

class PinProbe {
 public:
  static base::Result<PinProbe> create();

  /// Replaces the points (scene-local) and forgets all answers.
  void setPoints(std::vector<glm::vec3> points);
  /// Asks for all points again, since the picture has changed.
  void invalidate();
  /// Tests at most kMaxQueriesPerFrame of the points without an answer against the bound framebuffer, which must hold
  /// the depth of `camera`'s picture. `error_px`: how far the drawn surface may be from the true one, pixels. Leaves
  /// depth test and masks as drawing needs them.
  void draw(const base::Camera& camera, float error_px);
  /// Reads the answers that are available, without waiting.
  void poll();
  /// One entry for each point: its last answer, false before the first.
  const std::vector<bool>& visible() const { return visible_; }
  bool pending() const { return wanted_ > 0 || !in_flight_.empty(); }

 private:
  explicit PinProbe(base::gl::Program program);
  struct PendingQuery {
    std::size_t point;
    base::gl::Query query;
  };
  void startQuery(std::size_t point, const glm::vec4& clip);

  base::gl::Program program_;
  base::gl::VertexArray no_attributes_;
  std::vector<base::gl::Query> spare_;
  std::vector<PendingQuery> in_flight_;
  std::vector<glm::vec3> points_;
  std::vector<bool> visible_;
  std::size_t next_ = 0;    ///< the next point to test
  std::size_t wanted_ = 0;  ///< number of points from there on that wait for a test
};

}  // namespace client
