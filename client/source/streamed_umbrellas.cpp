#include "client/source/streamed_umbrellas.h"

#include "base/format_text.h"
#include "base/text.h"

namespace client {

template class StreamedPieces<UmbrellaTypes>;

StreamedUmbrellas::View StreamedUmbrellas::viewOf(const base::Camera& camera, const StreamedLook& look) const {
  View view = StreamedPieces::viewOf(camera, look);
  view.oriented = stream().header()->oriented;
  return view;
}

/// The triangles of points count, too.
void StreamedUmbrellas::meet(RayHit& hit, const Piece& piece) const {
  const lod::pmr::LeafPicture& picture = *piece.picture;
  if (!meetsBox(hit.ray, stream().leaves()[picture.leaf].box, hit.nearest)) return;
  const auto place = [&](std::uint16_t vertex) { return glm::dvec3(picture.vertices[vertex].position); };
  const std::vector<std::uint16_t>& corners = picture.list.corners;
  for (std::size_t i = 0; i + 2 < corners.size(); i += 3)
    hit.keep(distanceToTriangle(hit.ray, place(corners[i]), place(corners[i + 1]), place(corners[i + 2])));
  const lod::pmr::DrawnPart points = picture.list.pointsAt(piece.pixel);
  for (std::uint32_t i = points.first; i < points.end; ++i)
    hit.keep(distanceToPoint(hit.ray, place(picture.list.points[i]), 0.5 * static_cast<double>(piece.pixel)));
}

void StreamedUmbrellas::addFigures(StreamedStats& stats) const {
  stats.describe = describeUmbrellas;
  stats.umbrellas = {count().points, count().triangles, pieces().size(), stream().stats()};
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

}  // namespace client
