// QSplat, streamed block by block from a host of files (client::StreamedSplats), over six connections as in a browser.
#include "client/source/streamed_splats.h"
#include "compare/sim/host_player.h"
#include "protocol/welcome.h"

namespace compare {
namespace {

client::ViewerOptions splatOptions() {
  client::ViewerOptions options;
  options.method = client::Method::kQsplat;
  return options;
}

class SplatsPlayer final : public HostPlayer {
 public:
  SplatsPlayer(const Stage& stage, const client::FilePlace& file, protocol::Welcome welcome,
               std::unique_ptr<SimulatedFetcher> fetcher, const client::StreamedOptions& options,
               const LinkProfile& link)
      : HostPlayer(*fetcher, splatOptions(), stage, link),
        splats_(std::make_shared<client::StreamedSplats>(file, std::move(welcome), std::move(fetcher), options)) {
    viewer().setStreamed(splats_);
  }

  /// Splats become coarser with each frame that moves and finer with each at rest.
  base::Result<void> drawUnseen() override {
    const auto drawn = draw();
    return drawn ? base::Result<void>() : drawn.error();
  }
  bool atRest() const override { return HostPlayer::atRest() && !splats_->busy(); }
  PlayerCounts counts() const override {
    PlayerCounts counts = HostPlayer::counts();
    counts.bytes_patches = counts.bytes;
    const client::StreamedStats stats = splats_->stats();
    counts.cache_bytes = stats.file_bytes;
    counts.triangles = stats.drawn;
    return counts;
  }

 private:
  void pumpSource(double now) override { splats_->pump(viewer().session(), now); }

  std::shared_ptr<client::StreamedSplats> splats_;  // owns the fetcher
};

}  // namespace

base::Result<std::unique_ptr<Player>> makeSplatsPlayer(const Stage& stage, const MethodSetting& setting,
                                                       const LinkProfile& link) {
  const server::StreamedFile* const file = server::streamedFile(*stage.scene, base::kSplatMethod);
  if (file == nullptr)
    return base::Error{base::ErrorCode::kNotFound, "the scene has no splats; build it with --methods qsplat"};
  protocol::Welcome welcome = protocol::welcomeOf(stage.scene->scene, "scene");
  welcome.has_colors = stage.scene->scene.has_colors;
  client::StreamedOptions options;
  options.cutoff_px = static_cast<float>(setting.knob);
  options.clock = {};  // every frame of motion counts as if it took the time that it may take
  auto fetcher = std::make_unique<SimulatedFetcher>(
      [file](const std::string& name, std::uint64_t offset, std::uint64_t length) {
        return file->source->read(name, offset, length);
      },
      link, stage.seed);
  return std::unique_ptr<Player>(std::make_unique<SplatsPlayer>(stage,
                                                                client::FilePlace{"scene", "qsplat.lgq", file->bytes},
                                                                std::move(welcome), std::move(fetcher), options, link));
}

}  // namespace compare
