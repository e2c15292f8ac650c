// The published scene: the Grid-Lumigraph without a server, read by ranges from a host of files over six connections.
#include "compare/sim/host_player.h"
#include "compare/sim/published.h"
#include "repository/sampling/parameters.h"

namespace compare {
namespace {

class StaticPlayer final : public HostPlayer {
 public:
  StaticPlayer(const Stage& stage, const PublishedObjects& objects, double tolerance, const LinkProfile& link,
               std::unique_ptr<SimulatedFetcher> fetcher)
      : HostPlayer(*fetcher, viewerOptions(tolerance), stage, link),
        own_fetcher_(std::move(fetcher)),
        source_(objects.description(), *own_fetcher_,
                [](const std::string& text) { return repository::sampledPointsFromMeta(text, "scene"); }) {}

  base::Result<void> advance(double now, const base::ViewCamera& camera) override {
    LUMIGRID_TRY(HostPlayer::advance(now, camera));
    if (viewer().session().phase() == client::SessionPhase::kRefused)
      return base::Error{base::ErrorCode::kInvalidInput, source_.problem()};
    return {};
  }

 private:
  void pumpSource(double now) override { source_.pump(viewer().session(), now); }

  std::unique_ptr<SimulatedFetcher> own_fetcher_;
  client::StaticSource source_;
};

}  // namespace

base::Result<std::unique_ptr<Player>> makeStaticPlayer(const Stage& stage, const MethodSetting& setting,
                                                       const LinkProfile& link) {
  LUMIGRID_ASSIGN_OR_RETURN(const PublishedObjects* objects, stage.published());
  auto fetcher = std::make_unique<SimulatedFetcher>(
      [objects](const std::string& name, std::uint64_t offset, std::uint64_t length) {
        return objects->read(name, offset, length);
      },
      link, stage.seed);
  return std::unique_ptr<Player>(
      std::make_unique<StaticPlayer>(stage, *objects, setting.knob, link, std::move(fetcher)));
}

}  // namespace compare
