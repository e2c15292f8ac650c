#include "client/source/streamed_hlod.h"

#include <algorithm>
#include <string>
#include <utility>

#include "base/format_text.h"
#include "base/text.h"

namespace client {

namespace {

/// A shadow map takes at most this share of the memory, and all that are kept twice as much.
constexpr std::uint64_t kMapShare = 16;
/// Each GL has textures of so many texels a side.
constexpr int kLeastSide = 2048;
/// Texels of shadows are so many times larger at most while a view moves: two pixels. A choice.
constexpr float kMostCoarser = 4.0F;

}  // namespace

template class StreamedPieces<HlodTypes>;

// ---- shadows ----

void StreamedHlod::setQuality(const StreamedQuality& quality) {
  StreamedPieces::setQuality(quality);
  stream().setMemory(HlodTypes::streamBytes(options()));
}

lod::hlod::ShadowLight StreamedHlod::shadowLight(const StreamedLook& look, bool rests) const {
  const StreamedOptions& o = options();
  if (o.shadows == lod::hlod::Shadows::kNone) return kNoShadows;
  const bool has_place = o.light_position && !look.own_light;
  lod::hlod::ShadowLight light{glm::vec4(look.shading.light_direction, 0.0F)};
  if (has_place) light.place = glm::vec4(glm::vec3(*o.light_position - origin()), 1.0F);
  if (!rests || o.shadows != lod::hlod::Shadows::kSoft) return light;
  // The size of a light that has a place means nothing of one that is infinitely far.
  light.size = o.light_position && !has_place ? lod::hlod::kSunSize : o.light_size;
  if (const base::Sphere* const model = bounds(); model != nullptr && has_place && light.size <= 0.0F)
    light.size = lod::hlod::kSunSize * glm::length(glm::vec3(light.place) - model->center);
  return light;
}

void StreamedHlod::piecesChosen(const lod::hlod::TraverseRequest& request) {
  shadows_ = {};
  if (light() == kNoShadows) return stream().expectLights({});
  if (gl_side_ == 0) glGetIntegerv(GL_MAX_TEXTURE_SIZE, &gl_side_);
  gl_side_ = std::max(gl_side_, kLeastSide);
  const std::uint32_t side = lod::draw::shadowTexelsFor(options().memory_bytes / kMapShare, light().size > 0.0F);
  lod::draw::NodeLight at{light(), std::min(side, static_cast<std::uint32_t>(gl_side_))};
  at.kept_bytes = options().memory_bytes / kMapShare * 2;
  // Maps for a light that moves, or for a view that rests, serve no other frame.
  const bool stands = std::exchange(last_light_, at.light) == at.light;
  if (stands && !(at.light.size > 0.0F)) at.room = lod::draw::kRoomToMove;
  at.coarser = std::clamp(request.tolerance / finestPx(), 1.0F, kMostCoarser);
  shadows_ = shadow_finder_.find(stream(), pieces(), request, at);
}

base::Result<lod::draw::NodeCount> StreamedHlod::drawPieces(lod::draw::NodeRenderer& renderer, const View& view,
                                                            const lod::draw::NodeTarget& target) {
  if (options().shadows == lod::hlod::Shadows::kNone) renderer.dropShadows();
  return renderer.draw(pieces(), view, target, light() == kNoShadows ? nullptr : &shadows_);
}

// ---- rays and figures ----

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
  using lod::hlod::Shadows;
  const Shadows kind = light() == kNoShadows ? Shadows::kNone : light().size > 0.0F ? Shadows::kSoft : Shadows::kHard;
  stats.hlod = {count().triangles, count().points, kind, shadows_.maps.size(), 0, 0, stream().stats()};
  for (const lod::draw::NodeShadowMap& map : shadows_.maps) {
    stats.hlod.casters += map.casters.size();
    const base::Camera& camera = map.plan.camera;
    stats.hlod.shadow_texels += static_cast<std::uint64_t>(camera.width) * static_cast<std::uint64_t>(camera.height);
  }
}

std::vector<StatisticsLine> describeHlod(const StreamedStats& s) {
  const HlodStats& hlod = s.hlod;
  const auto count = [](std::uint64_t value) { return base::formatCount(value, ' '); };
  std::string shadows(lod::hlod::nameOf(hlod.shadows));
  if (hlod.shadows != lod::hlod::Shadows::kNone)
    shadows += ", of " + count(hlod.casters) + " nodes in " + count(hlod.shadow_maps) +
               (hlod.shadow_maps == 1 ? " map" : " maps") +
               base::formatText(" of %.1f M texels", 1e-6 * static_cast<double>(hlod.shadow_texels));
  return {{"drawn", count(hlod.triangles) + " triangles, " + count(hlod.points) + " points"},
          {"shadows", shadows},
          {"screen error", base::formatText("down to %.2f px", static_cast<double>(s.error_px))},
          {"nodes", count(hlod.stream.drawn) + " in view, " + count(hlod.stream.present) + " of " +
                        count(hlod.stream.nodes) + " here, " + count(hlod.stream.lacking) + " to be refined"}};
}

}  // namespace client
