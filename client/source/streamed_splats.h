#pragma once
// Streams a qsplat.lgq from any host that answers byte ranges, and draws it (Rusinkiewicz and Levoy 2001).
#include <memory>
#include <string>

#include "client/source/fetch.h"
#include "client/source/splat_view.h"
#include "lod/qsplat/rate_control.h"

namespace client {

/// The address of a file of splats.
struct SplatFilePlace {
  std::string place;  ///< the scene's URL without a slash at its end, for error messages
  std::string name;   ///< name of the object, "qsplat.lgq" or "qsplat-….lgq"
  std::uint64_t bytes = 0;
};

class StreamedSplats final : public SplatView {
 public:
  /// `welcome` holds the values of scene.json; only the fields that SplatView needs are used.
  StreamedSplats(SplatFilePlace file, protocol::Welcome welcome, std::unique_ptr<RangeFetcher> fetcher,
                 const SplatOptions& options);
  /// Shows a whole file that is on this machine. `blocks`: not null.
  StreamedSplats(SplatFilePlace file, protocol::Welcome welcome, std::shared_ptr<lod::qsplat::FileBlocks> blocks,
                 const SplatOptions& options);

  bool pump(Session& session, double now) override;
  const base::Sphere* bounds() const override;
  void update(const base::Camera& camera, const SplatLook& look) override;
  base::Result<void> draw(const base::Camera& camera, const SplatLook& look) override;
  std::optional<glm::vec3> surfaceAt(const base::Camera& camera, const SplatLook& look, double x,
                                     double y) const override;
  bool complete() const override;
  bool busy() const override;
  void setQuality(const SplatQuality& quality) override;
  const SplatQuality& quality() const override { return options_; }
  void contextLost() override { renderer_.reset(); }
  SplatStats stats() const override;

  const lod::qsplat::Stream& stream() const { return stream_; }

 private:
  void acceptAnswer(Session& session, FetchAnswer& answer, double now);
  void sendWelcome(Session& session);
  float wantedCutoff() const;
  float finestCutoff() const;
  void chooseSplats(const base::Camera& camera, const SplatLook& look);
  void setPace(const base::Camera& camera);
  base::Result<void> drawFound(const base::Camera& camera, const SplatLook& look);
  bool moreIsComing() const;
  bool hasRested() const;
  double now() const { return options_.clock ? options_.clock() : 0.0; }

  const SplatFilePlace file_;
  const base::Bytes welcome_;
  const std::unique_ptr<RangeFetcher> fetcher_;  ///< null where the whole file is here
  SplatOptions options_;
  lod::qsplat::Stream stream_;
  bool host_away_ = false;  ///< the last request got no answer
  std::string refusal_;     ///< a failure that no other try repairs; empty when there is none

  lod::qsplat::RateControl rate_;
  lod::qsplat::Traversal found_;
  std::uint64_t found_generation_ = 0;  ///< generation of the stream when found_ was chosen
  bool chosen_ = false;
  base::Camera camera_;  ///< camera for which found_ was chosen; the next four members belong to that choice, too
  glm::vec4 section_ = base::kNoSection;
  std::optional<lod::qsplat::Lens> lens_;
  float cutoff_px_ = 0.0F;
  float cutoff_factor_ = 1.0F;  ///< factor by which memory limits coarsen the cut-off in this view, ≥ 1

  std::optional<base::Camera> drawn_from_;
  double choice_end_ = -1e300;   ///< seconds; end of the last choice of splats, or of drawing them
  double choice_seconds_ = 0.0;  ///< seconds; duration of that
  float reduction_ = 1.0F;       ///< resolution of the last drawing, pixels a side for each sample
  std::unique_ptr<lod::draw::SplatRenderer> renderer_;
};

}  // namespace client
