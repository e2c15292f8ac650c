#pragma once
// Streams a hlod.lgh from any host that answers byte ranges, and draws the triangles and points of its nodes (Guthe et
// al. 2004, section 4).
#include <vector>

#include "client/source/streamed_pieces.h"
#include "lod/draw/node_shadows.h"

namespace client {

struct HlodTypes {
  using Stream = lod::hlod::Stream;
  using StreamOptions = lod::hlod::StreamOptions;
  using TraverseRequest = lod::hlod::TraverseRequest;
  using Piece = lod::hlod::DrawnNode;
  using Renderer = lod::draw::NodeRenderer;
  using View = lod::draw::NodeView;
  using Target = lod::draw::NodeTarget;
  using Count = lod::draw::NodeCount;
  static bool isWhole(const lod::hlod::StreamStats& /*stats*/, std::size_t pieces) { return pieces > 0; }
  /// Shadows take one and a half of seven sixteenths: their maps may take two sixteenths, and casters lie on the GPU
  /// beside nodes, both smaller there than in the stream.
  static std::uint64_t streamBytes(const StreamedOptions& options) {
    return options.memory_bytes / 32 * (options.shadows == lod::hlod::Shadows::kNone ? 14 : 11);
  }
  static constexpr std::uint64_t kMinMemory = lod::hlod::kMinStreamMemory;
  static constexpr float StreamedQuality::*kSize = &StreamedQuality::error_px;
  static constexpr float kMinSize = kMinErrorPx;
};

extern template class StreamedPieces<HlodTypes>;

class StreamedHlod final : public StreamedPieces<HlodTypes> {
 public:
  using StreamedPieces::StreamedPieces;
  void setQuality(const StreamedQuality& quality) override;

 private:
  lod::hlod::ShadowLight shadowLight(const StreamedLook& look, bool rests) const override;
  void piecesChosen(const lod::hlod::TraverseRequest& request) override;
  base::Result<lod::draw::NodeCount> drawPieces(lod::draw::NodeRenderer& renderer, const View& view,
                                                const lod::draw::NodeTarget& target) override;
  void meet(RayHit& hit, const Piece& piece) const override;
  void addFigures(StreamedStats& stats) const override;

  lod::draw::NodeShadowFinder shadow_finder_;
  lod::draw::NodeShadows shadows_;     ///< on pieces()
  lod::hlod::ShadowLight last_light_;  ///< of the last frame with shadows
  int gl_side_ = 0;                    ///< the most texels of a side that the GL allows; 0: not asked yet
};

/// The statistics of triangles and points.
std::vector<StatisticsLine> describeHlod(const StreamedStats& stats);

}  // namespace client
