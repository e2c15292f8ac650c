#pragma once
// Streams a hlod.lgh from any host that answers byte ranges, and draws the triangles and points of its nodes (Guthe et
// al. 2004, section 4).
#include <vector>

#include "client/source/streamed_pieces.h"
#include "lod/draw/hlod_nodes.h"

namespace client {

struct HlodTypes {
  using Stream = lod::hlod::Stream;
  using StreamOptions = lod::hlod::StreamOptions;
  using TraverseRequest = lod::hlod::TraverseRequest;
  using Piece = lod::hlod::DrawnNode;
  using Renderer = lod::draw::NodeRenderer;
  using View = lod::draw::NodeView;
  using Count = lod::draw::NodeCount;
  static constexpr std::uint64_t kMinMemory = lod::hlod::kMinStreamMemory;
  static constexpr float StreamedQuality::*kSize = &StreamedQuality::error_px;
  static constexpr float kMinSize = kMinErrorPx;
};

extern template class StreamedPieces<HlodTypes>;

class StreamedHlod final : public StreamedPieces<HlodTypes> {
 public:
  using StreamedPieces::StreamedPieces;

 private:
  void meet(RayHit& hit, const Piece& piece) const override;
  void addFigures(StreamedStats& stats) const override;
};

/// The statistics of triangles and points.
std::vector<StatisticsLine> describeHlod(const StreamedStats& stats);

}  // namespace client
