#pragma once
// Streams a pmr.lgm from any host that answers byte ranges, and draws its points and umbrella triangles (Dey and Hudson
// 2002).
#include <memory>
#include <vector>

#include "client/source/duty_cycle.h"
#include "client/source/motion_pace.h"
#include "client/source/streamed_draw.h"
#include "client/source/streamed_file.h"
#include "client/source/streamed_view.h"
#include "lod/draw/umbrellas.h"

namespace client {

class StreamedUmbrellas final : public StreamedView {
 public:
  /// `welcome` and `fetcher`: as in StreamedFile.
  StreamedUmbrellas(FilePlace file, const protocol::Welcome& welcome, std::unique_ptr<RangeFetcher> fetcher,
                    const StreamedOptions& options);
  /// Shows a whole file that is on this machine. `bytes`: not null.
  StreamedUmbrellas(FilePlace file, const protocol::Welcome& welcome, std::shared_ptr<const lod::FileBytes> bytes,
                    const StreamedOptions& options);

  bool pump(Session& session, double now) override;
  const base::Sphere* bounds() const override;
  void update(const base::Camera& camera, const StreamedLook& look) override;
  base::Result<void> draw(const base::Camera& camera, const StreamedLook& look) override;
  bool isMultisampled() const override { return true; }
  std::optional<glm::vec3> surfaceAt(const base::Camera& camera, const StreamedLook& look, double x,
                                     double y) const override;
  bool complete() const override;
  bool busy() const override;
  void setQuality(const StreamedQuality& quality) override;
  const StreamedQuality& quality() const override { return options_; }
  void contextLost() override {
    renderer_.reset();
    drawn_.remove();
  }
  StreamedStats stats() const override;

 private:
  void choose(std::uint32_t frames);
  bool moreIsComing() const;
  bool hasRested() const;
  double now() const { return options_.clock ? options_.clock() : 0.0; }
  float wantedTolerance() const { return pace_.wantedPx(options_.tolerance); }
  base::Result<void> drawChosen(const base::Camera& camera, const StreamedLook& look);

  StreamedFile file_;
  StreamedOptions options_;
  lod::pmr::Stream stream_;
  MotionPace pace_;

  std::vector<lod::pmr::DrawnLeaf> leaves_;
  std::uint64_t chosen_generation_ = 0;  ///< generation of the stream when leaves_ was chosen
  bool chosen_ = false;
  bool moved_ = false;        ///< the last frame drawn was of a view that moved
  bool has_undrawn_ = false;  ///< leaves_ was chosen anew since the last update()
  base::Camera camera_;       ///< camera for which leaves_ was chosen; the next two members belong to that choice, too
  glm::vec4 section_ = base::kNoSection;
  float tolerance_ = 1.0F;
  DutyCycle frames_;
  PictureFence drawn_;        ///< behind the last picture, while frames_ does not know its end
  double drawn_begin_ = 0.0;  ///< when that picture was begun

  lod::draw::UmbrellaCount count_;  ///< of the last drawing
  std::unique_ptr<lod::draw::UmbrellaRenderer> renderer_;
};

/// The statistics of points and umbrellas.
std::vector<StatisticsLine> describeUmbrellas(const StreamedStats& stats);

}  // namespace client
