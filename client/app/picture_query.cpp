#include "client/app/picture_query.h"

#include <array>
#include <cstdio>

namespace client {
namespace {

/// Writes a number so that it reads back as the same double.
std::string exact(double value) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.17g", value);
  return text.data();
}

std::string exact(const glm::dvec3& v) {
  return exact(v.x) + "," + exact(v.y) + "," + exact(v.z);
}

}  // namespace

std::string pictureQuery(const base::ViewCamera& camera, const ViewState& view, double tolerance_px) {
  std::string query = "position=" + exact(camera.position) + "&direction=" + exact(camera.direction) +
                      "&up=" + exact(camera.up) + "&fov_y=" + exact(camera.fov_y);
  if (camera.orthographic()) query += "&ortho_height=" + exact(camera.ortho_height);
  if (view.section.on)
    query += std::string("&section=") + static_cast<char>('x' + view.section.axis) + "," + exact(view.section.offset) +
             (view.section.keep_below ? ",b" : ",a");
  if (view.colors_by_resolution) query += "&colors=resolution&tolerance=" + exact(tolerance_px);
  return query;
}

}  // namespace client
