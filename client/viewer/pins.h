#pragma once
// Which world points are seen and which are behind the drawn surface: one occlusion query for each, against the depth
// of the frame that was just drawn. No extra pass over the geometry, nothing read back, nothing waited for.
#include <glm/glm.hpp>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/gl/gl.h"

namespace client {

class PinProbe {
 public:
  static base::Result<PinProbe> create();

  /// Points are scene-local. Known answers are forgotten.
  void setPoints(std::vector<glm::vec3> points);
  /// The picture has changed: all answers are to be found again.
  void invalidate();
  /// Tests some of the points whose answers are wanted (kPinsPerFrame) against the framebuffer bound now, which must
  /// hold the depth of `camera`'s picture. `error_px`: how far the drawn surface may be from the true one. Leaves depth
  /// test and masks as for drawing.
  void draw(const base::Camera& camera, const glm::vec4& section, float error_px);
  /// Takes what answers are there, without waiting.
  void poll();
  /// Beside the points; the last answer of each, false before its first.
  const std::vector<bool>& visible() const { return visible_; }
  bool pending() const { return wanted_ > 0 || !in_flight_.empty(); }

 private:
  struct InFlight {
    std::size_t point;
    base::gl::Query query;
  };
  void ask(std::size_t point, const glm::vec4& clip);

  base::gl::Program program_;
  base::gl::VertexArray no_attributes_;
  std::vector<base::gl::Query> spare_;
  std::vector<InFlight> in_flight_;
  std::vector<glm::vec3> points_;
  std::vector<bool> visible_;
  std::size_t next_ = 0;    ///< the point whose turn it is
  std::size_t wanted_ = 0;  ///< so many from there on
};

}  // namespace client
