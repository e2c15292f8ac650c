#include "client/native/splat_link.h"

#include <chrono>
#include <utility>

#include "base/parallel.h"
#include "client/native/curl_fetcher.h"
#include "client/native/published_scene.h"

namespace client {
namespace {

double secondsNow() {
  return std::chrono::duration<double>(LinkClock::Clock::now().time_since_epoch()).count();
}

}  // namespace

struct SplatLink::Impl {
  Impl(const std::string& where, const LinkLimit& limit, const SplatOptions& wanted)
      : place(where),
        options(wanted),
        fetcher(std::make_unique<CurlFetcher>(place, limit)),
        connection(fetcher.get()),
        scene_json(*fetcher, place) {
    if (!options.clock) options.clock = secondsNow;
    options.for_each = [](std::size_t count, const std::function<void(std::size_t)>& body) {
      base::parallelFor(count, 0, body);
    };
  }
  void acceptScene(const std::string& text, Session& session);

  const std::string place;
  SplatOptions options;
  std::unique_ptr<CurlFetcher> fetcher;  // until the splats take it over
  CurlFetcher* connection;               // the same fetcher, whoever owns it
  SceneJson scene_json;
  bool refused = false;
  std::shared_ptr<StreamedSplats> splats;
};

void SplatLink::Impl::acceptScene(const std::string& text, Session& session) {
  const auto scene = base::parseScene(text, place + "/scene.json");
  const auto part = scene ? partOf(*scene, "qsplat", ".lgq") : std::nullopt;
  if (!part) {
    refused = true;
    if (!scene) return session.refuse(scene.error().message);
    return session.refuse(place + ": has no splats (qsplat.lgq); build them with `lumigrid build ... --methods qsplat`",
                          partOf(*scene, "patch", ".lgp") ? std::optional(Method::kLumigraph) : std::nullopt);
  }
  protocol::Welcome welcome = welcomeFrom(*scene, place);
  welcome.has_colors = scene->has_colors;
  splats = std::make_shared<StreamedSplats>(SplatFilePlace{place, part->name, part->bytes}, std::move(welcome),
                                            std::move(fetcher), options);
}

SplatLink::SplatLink(const std::string& place, const LinkLimit& limit, const SplatOptions& options)
    : impl_(std::make_unique<Impl>(place, limit, options)) {}
SplatLink::~SplatLink() = default;

bool SplatLink::pump(Session& session) {
  Impl& s = *impl_;
  if (s.refused) return false;
  if (s.splats) return s.splats->pump(session, secondsNow());
  const auto text = s.scene_json.takeText(session, secondsNow());
  if (text) s.acceptScene(*text, session);
  return text.has_value();
}

void SplatLink::waitForArrival(double seconds) {
  impl_->connection->wait(seconds);
}

LinkCounts SplatLink::counts() const {
  const Impl& s = *impl_;
  if (!s.splats) return {1, s.scene_json.bytes()};
  const lod::qsplat::StreamStats stats = s.splats->stream().stats();
  return {1 + stats.requests, s.scene_json.bytes() + stats.bytes_received};
}

std::shared_ptr<SplatView> SplatLink::splats() const {
  return impl_->splats;
}

}  // namespace client
