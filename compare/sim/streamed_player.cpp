// Methods of a file of their own, streamed from a host of files over six connections as in a browser: QSplat
// (client::StreamedSplats), points and umbrellas (client::StreamedUmbrellas), triangles and points
// (client::StreamedHlod).
#include "client/source/streamed_hlod.h"
#include "client/source/streamed_splats.h"
#include "client/source/streamed_umbrellas.h"
#include "compare/sim/host_player.h"
#include "protocol/welcome.h"

namespace compare {
namespace {

client::ViewerOptions viewerOptions(client::Method method) {
  client::ViewerOptions options;
  options.method = method;
  return options;
}

class StreamedPlayer final : public HostPlayer {
 public:
  /// `view` owns the fetcher.
  StreamedPlayer(const Stage& stage, client::Method method, SimulatedFetcher& fetcher,
                 std::shared_ptr<client::StreamedView> view, const LinkProfile& link)
      : HostPlayer(fetcher, viewerOptions(method), stage, link), view_(std::move(view)) {
    viewer().setStreamed(view_);
  }

  /// The view becomes coarser with each frame that moves and finer with each at rest.
  base::Result<void> drawUnseen() override {
    const auto drawn = draw();
    return drawn ? base::Result<void>() : drawn.error();
  }
  std::optional<bool> isLate() const override { return view_->stats().lacking > 0; }
  bool atRest() const override { return HostPlayer::atRest() && !view_->busy(); }
  PlayerCounts counts() const override {
    PlayerCounts counts = HostPlayer::counts();
    counts.bytes_patches = counts.bytes;
    const client::StreamedStats stats = view_->stats();
    counts.cache_bytes = stats.file_bytes;
    counts.triangles = stats.drawn;
    return counts;
  }

 private:
  void pumpSource(double now) override { view_->pump(viewer().session(), now); }

  std::shared_ptr<client::StreamedView> view_;
};

/// `View`: client::StreamedSplats, client::StreamedUmbrellas or client::StreamedHlod.
template <class View>
base::Result<std::unique_ptr<Player>> makeStreamedPlayer(const Stage& stage, const LinkProfile& link,
                                                         const base::StreamedMethod& of, client::Method method,
                                                         client::StreamedOptions options) {
  const server::StreamedFile* const file = server::streamedFile(*stage.scene, of);
  if (file == nullptr)
    return base::Error{base::ErrorCode::kNotFound,
                       "the scene has no " + of.file() + "; build it with --methods " + std::string(of.name)};
  protocol::Welcome welcome = protocol::welcomeOf(stage.scene->scene, "scene");
  welcome.has_colors = stage.scene->scene.has_colors;
  if (stage.idle_bytes) options.idle_bytes = *stage.idle_bytes;
  options.clock = {};  // every frame of motion counts as if it took the time that it may take
  auto fetcher = std::make_unique<SimulatedFetcher>(
      [file](const std::string& name, std::uint64_t offset, std::uint64_t length) {
        return file->source->read(name, offset, length);
      },
      link, stage.seed);
  SimulatedFetcher& read_by = *fetcher;
  auto view =
      std::make_shared<View>(client::FilePlace{"scene", of.file(), file->bytes}, welcome, std::move(fetcher), options);
  return std::unique_ptr<Player>(std::make_unique<StreamedPlayer>(stage, method, read_by, std::move(view), link));
}

}  // namespace

base::Result<std::unique_ptr<Player>> makeSplatsPlayer(const Stage& stage, const MethodSetting& setting,
                                                       const LinkProfile& link) {
  client::StreamedOptions options;
  options.cutoff_px = static_cast<float>(setting.knob);
  return makeStreamedPlayer<client::StreamedSplats>(stage, link, base::kSplatMethod, client::Method::kQsplat, options);
}

base::Result<std::unique_ptr<Player>> makeUmbrellasPlayer(const Stage& stage, const MethodSetting& setting,
                                                          const LinkProfile& link) {
  client::StreamedOptions options;
  options.tolerance = static_cast<float>(setting.knob);
  return makeStreamedPlayer<client::StreamedUmbrellas>(stage, link, base::kUmbrellaMethod, client::Method::kPmr,
                                                       options);
}

base::Result<std::unique_ptr<Player>> makeHlodPlayer(const Stage& stage, const MethodSetting& setting,
                                                     const LinkProfile& link) {
  client::StreamedOptions options;
  options.error_px = static_cast<float>(setting.knob);
  options.shadows = shadowsOf(setting.method);
  return makeStreamedPlayer<client::StreamedHlod>(stage, link, base::kHlodMethod, client::Method::kHlod, options);
}

}  // namespace compare
