#pragma once
// Streams a pmr.lgm from any host that answers byte ranges, and draws its points and umbrella triangles (Dey and Hudson
// 2002).
#include <vector>

#include "client/source/streamed_pieces.h"
#include "lod/draw/umbrellas.h"

namespace client {

struct UmbrellaTypes {
  using Stream = lod::pmr::Stream;
  using StreamOptions = lod::pmr::StreamOptions;
  using TraverseRequest = lod::pmr::TraverseRequest;
  using Piece = lod::pmr::DrawnLeaf;
  using Renderer = lod::draw::UmbrellaRenderer;
  using View = lod::draw::UmbrellaView;
  using Target = lod::draw::SurfaceTarget;
  using Count = lod::draw::UmbrellaCount;
  static bool isWhole(const lod::pmr::StreamStats& stats, std::size_t pieces) { return pieces >= stats.chosen; }
  static std::uint64_t streamBytes(const StreamedOptions& options) { return options.memory_bytes / 16 * 7; }
  static constexpr std::uint64_t kMinMemory = lod::pmr::kMinStreamMemory;
  static constexpr float StreamedQuality::*kSize = &StreamedQuality::tolerance;
  static constexpr float kMinSize = kMinTolerance;
};

extern template class StreamedPieces<UmbrellaTypes>;

class StreamedUmbrellas final : public StreamedPieces<UmbrellaTypes> {
 public:
  using StreamedPieces::StreamedPieces;

 private:
  View viewOf(const base::Camera& camera, const StreamedLook& look) const override;
  void meet(RayHit& hit, const Piece& piece) const override;
  void addFigures(StreamedStats& stats) const override;
};

/// The statistics of points and umbrellas.
std::vector<StatisticsLine> describeUmbrellas(const StreamedStats& stats);

}  // namespace client
