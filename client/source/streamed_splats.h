#pragma once
// Streams a qsplat.lgq from any host that answers byte ranges, and draws it (Rusinkiewicz and Levoy 2001).
#include <memory>
#include <string>
#include <vector>

#include "client/source/duty_cycle.h"
#include "client/source/motion_pace.h"
#include "client/source/streamed_file.h"
#include "client/source/streamed_view.h"

namespace client {

class StreamedSplats final : public StreamedView {
 public:
  /// `welcome` and `fetcher`: as in StreamedFile.
  StreamedSplats(FilePlace file, const protocol::Welcome& welcome, std::unique_ptr<RangeFetcher> fetcher,
                 const StreamedOptions& options);
  /// Shows a whole file that is on this machine. `blocks`: not null.
  StreamedSplats(FilePlace file, const protocol::Welcome& welcome, std::shared_ptr<lod::qsplat::FileBlocks> blocks,
                 const StreamedOptions& options);

  bool pump(Session& session, double now) override { return file_.pump(stream_, session, now); }
  const base::Sphere* bounds() const override;
  void update(const base::Camera& camera, const StreamedLook& look) override;
  base::Result<void> draw(const base::Camera& camera, const StreamedLook& look) override;
  base::Camera drawnCamera() const override { return renderer_ ? renderer_->drawnCamera() : camera_; }
  bool isMultisampled() const override { return false; }
  std::optional<glm::vec3> surfaceAt(const base::Camera& camera, double x, double y) const override;
  bool complete() const override;
  bool busy() const override;
  void setQuality(const StreamedQuality& quality) override;
  const StreamedQuality& quality() const override { return options_; }
  void contextLost() override { renderer_.reset(); }
  StreamedStats stats() const override;

  const lod::qsplat::Stream& stream() const { return stream_; }

 private:
  float finestCutoff() const;
  void chooseSplats(const base::Camera& camera, const StreamedLook& look);
  base::Result<void> drawFound(const base::Camera& camera, const StreamedLook& look);
  bool moreIsComing() const;
  bool hasRested() const;
  double now() const { return options_.clock ? options_.clock() : 0.0; }

  StreamedFile file_;
  StreamedOptions options_;
  lod::qsplat::Stream stream_;
  MotionPace pace_;
  lod::qsplat::Traversal found_;
  std::uint64_t found_generation_ = 0;  ///< generation of the stream when found_ was chosen
  bool chosen_ = false;
  base::Camera camera_;  ///< camera for which found_ was chosen; the next three members belong to that choice, too
  std::optional<lod::qsplat::Lens> lens_;
  float cutoff_px_ = 0.0F;
  float cutoff_factor_ = 1.0F;  ///< factor by which memory limits coarsen the cut-off in this view, ≥ 1

  DutyCycle choices_;       ///< of splats, or the drawing of them
  float reduction_ = 1.0F;  ///< resolution of the last drawing, pixels a side for each sample
  std::unique_ptr<lod::draw::SplatRenderer> renderer_;
};

/// The statistics of splats.
std::vector<StatisticsLine> describeSplats(const StreamedStats& stats);

}  // namespace client
