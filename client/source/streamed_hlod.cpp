#include "client/source/streamed_hlod.h"

#include "base/format_text.h"
#include "base/text.h"

namespace client {

template class StreamedPieces<HlodTypes>;

/// Points, and the lines that cover cracks, count as they are drawn: at least a pixel wide, and on either side as far
/// as the node's error.
void StreamedHlod::meet(RayHit& hit, const Piece& piece) const {
  const lod::hlod::NodePicture& picture = *piece.picture;
  if (!meetsBox(hit.ray, stream().nodes()[picture.node].box, hit.nearest)) return;
  const auto place = [&](std::uint32_t vertex) { return glm::dvec3(picture.vertices[vertex].position); };
  const std::vector<std::uint32_t>& triangles = picture.triangles;
  for (std::size_t i = 0; i + 2 < triangles.size(); i += 3)
    hit.keep(distanceToTriangle(hit.ray, place(triangles[i]), place(triangles[i + 1]), place(triangles[i + 2])));
  const auto error = static_cast<double>(picture.error);
  const double pixel = piece.error_px > 0.0F ? error / static_cast<double>(piece.error_px) : 0.0;
  const double radius = std::max(error, 0.5 * pixel);
  for (std::uint32_t i = 0; i < picture.points; ++i) hit.keep(distanceToPoint(hit.ray, place(i), radius));
  const std::vector<std::uint32_t>& edges = picture.edges;
  for (std::size_t i = 0; i + 1 < edges.size(); i += 2)
    hit.keep(distanceToLine(hit.ray, place(edges[i]), place(edges[i + 1]), radius));
}

void StreamedHlod::addFigures(StreamedStats& stats) const {
  stats.describe = describeHlod;
  stats.hlod = {count().triangles, count().points, stream().stats()};
}

std::vector<StatisticsLine> describeHlod(const StreamedStats& s) {
  const HlodStats& hlod = s.hlod;
  const auto count = [](std::uint64_t value) { return base::formatCount(value, ' '); };
  return {{"drawn", count(hlod.triangles) + " triangles, " + count(hlod.points) + " points"},
          {"screen error", base::formatText("down to %.2f px", static_cast<double>(s.error_px))},
          {"nodes", count(hlod.stream.drawn) + " in view, " + count(hlod.stream.present) + " of " +
                        count(hlod.stream.nodes) + " here, " + count(hlod.stream.lacking) + " to be refined"}};
}

}  // namespace client
