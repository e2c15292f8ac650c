#include "client/native/published_scene.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <utility>

#include "client/native/connection.h"
#include "client/native/curl_fetcher.h"
#include "client/native/splat_link.h"
#include "protocol/welcome.h"
#include "repository/sampling/parameters.h"

namespace client {
namespace {

constexpr std::uint64_t kMaxJsonBytes = std::uint64_t{16} << 20;
constexpr std::uint64_t kSceneJsonId = ~std::uint64_t{0};  // no id of a range
constexpr double kMinPause = 0.25, kMaxPause = 5.0;        // seconds between attempts, as in connection.cpp

/// Names a scene by the last part of its address; where there is none, by its source: "tower" from "/scans/tower.ply".
std::string nameOf(const std::string& place, const base::Scene& scene) {
  const std::size_t host = place.find("://");
  const bool has_folder = host == std::string::npos || place.find('/', host + 3) != std::string::npos;
  const std::string last = place.substr(place.rfind('/') + 1);
  if (has_folder || scene.sources.empty()) return last;
  const std::string& source = scene.sources.front().path;
  const std::string stem = source.substr(source.rfind('/') + 1);
  return stem.empty() ? last : stem.substr(0, stem.rfind('.'));
}

}  // namespace

std::optional<StaticObject> partOf(const base::Scene& scene, const std::string& stem, const std::string& extension) {
  const auto file = base::partFile(scene, stem, extension);
  if (!file) return std::nullopt;
  const auto part = std::find_if(scene.parts.begin(), scene.parts.end(),
                                 [&](const base::ScenePart& one) { return one.file == *file; });
  if (part == scene.parts.end()) return std::nullopt;
  return StaticObject{part->file, part->bytes};
}

protocol::Welcome welcomeFrom(const base::Scene& scene, const std::string& place) {
  return protocol::welcomeOf(scene, nameOf(place, scene));
}

base::Result<StaticScene> staticSceneFrom(const std::string& scene_json, const std::string& place) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto scene, base::parseScene(scene_json, place + "/scene.json"));
  const auto patches = partOf(scene, "patch", ".lgp");
  if (!patches && partOf(scene, "qsplat", ".lgq"))
    return base::Error{base::ErrorCode::kUnsupported, place + ": holds splats only; --method qsplat shows them"};
  if (!patches || !base::isPublishedName(patches->name))
    return base::Error{base::ErrorCode::kInvalidInput,
                       place + ": is not a published scene; put there what `lumigrid publish` wrote"};
  StaticScene out;
  out.place = place;
  out.patches = *patches;
  out.index = partOf(scene, "images/index", ".lgi");
  out.welcome = welcomeFrom(scene, place);
  return out;
}

ReadParameters parametersReader() {
  return [](const std::string& text) { return repository::sampledPointsFromMeta(text, "parameters"); };
}

std::string placeOfScene(const std::string& url) {
  std::string place = url.substr(0, url.find_first_of("?#"));
  const std::string file = "scene.json";
  if (place.size() > file.size() && place.compare(place.size() - file.size(), file.size(), file) == 0 &&
      place[place.size() - file.size() - 1] == '/')
    place.resize(place.size() - file.size());
  while (!place.empty() && place.back() == '/') place.pop_back();
  return place;
}

bool isPublishedScene(const std::string& url) {
  if (url.rfind("https://", 0) == 0) return true;
  if (url.rfind("http://", 0) != 0) return false;
  const std::size_t slash = url.find('/', 7);
  if (slash == std::string::npos) return false;
  const std::string path = url.substr(slash);
  return path != "/" && path != "/ws";
}

base::Result<void> checkUrl(const std::string& url) {
  if (!isPublishedScene(url)) {
    if (auto server = parseServerUrl(url); !server) return server.error();
    return {};
  }
  const bool odd = url.find_first_of(" \t\r\n@") != std::string::npos;
  const std::size_t host = url.find("://") + 3;
  if (!odd && host < url.size() && url[host] != '/') return {};
  return base::Error{base::ErrorCode::kInvalidInput,
                     "'" + url +
                         "': " + (odd ? "it holds a character that an address cannot have" : "it names no host") +
                         "; write it like https://example.org/scenes/tower/"};
}

base::Result<std::unique_ptr<Link>> openLink(const std::string& url, const LinkLimit& limit) {
  if (isPublishedScene(url)) return std::unique_ptr<Link>(std::make_unique<PublishedSceneLink>(url, limit));
  LUMIGRID_ASSIGN_OR_RETURN(auto server, parseServerUrl(url));
  return std::unique_ptr<Link>(std::make_unique<Connection>(server, limit));
}

base::Result<std::unique_ptr<Link>> openSplatLink(const std::string& url, const LinkLimit& limit,
                                                  const SplatOptions& options) {
  LUMIGRID_TRY(checkUrl(url));
  if (isPublishedScene(url))
    return std::unique_ptr<Link>(std::make_unique<SplatLink>(placeOfScene(url), limit, options));
  LUMIGRID_ASSIGN_OR_RETURN(const auto server, parseServerUrl(url));
  // A server with several scenes has each in a folder of its own.
  const std::string place = placeOfScene("http://" + server.authority() + server.target);
  return std::unique_ptr<Link>(std::make_unique<SplatLink>(place, limit, options));
}

// ---- scene.json ----

SceneJson::SceneJson(CurlFetcher& fetcher, std::string place) : fetcher_(fetcher), place_(std::move(place)) {
  requestText();
}

void SceneJson::requestText() {
  fetcher_.submitWhole(kSceneJsonId, "scene.json", kMaxJsonBytes);
  asked_ = true;
}

std::optional<std::string> SceneJson::takeText(Session& session, double now) {
  if (!asked_ && now >= retry_at_) requestText();
  const auto answers = fetcher_.takeAnswers();
  if (answers.empty()) return std::nullopt;
  const FetchAnswer& answer = answers.front();
  if (answer.outcome == FetchOutcome::kBytes) {
    bytes_ = answer.bytes.size();
    return std::string(answer.bytes.begin(), answer.bytes.end());
  }
  const std::string why = describeFailure(answer, place_ + "/scene.json");
  asked_ = !isTransient(answer);
  if (asked_)
    session.refuse(why);
  else
    session.disconnected(why);
  retry_at_ = now + std::min(kMaxPause, kMinPause * std::exp2(std::min(failures_++, 8)));
  return std::nullopt;
}

// ---- the link ----

struct PublishedSceneLink::Impl {
  Impl(const std::string& url, const LinkLimit& limit)
      : place(placeOfScene(url)), fetcher(place, limit), scene_json(fetcher, place) {}

  double now() const { return std::chrono::duration<double>(LinkClock::Clock::now() - start).count(); }
  bool acceptScene(Session& session);

  std::string place;
  LinkClock::Clock::time_point start = LinkClock::Clock::now();
  CurlFetcher fetcher;
  SceneJson scene_json;
  bool refused = false;
  std::unique_ptr<StaticSource> source;
};

/// Opens the scene when scene.json has arrived.
bool PublishedSceneLink::Impl::acceptScene(Session& session) {
  if (refused) return false;
  const auto text = scene_json.takeText(session, now());
  if (!text) return false;
  auto scene = staticSceneFrom(*text, place);
  if (!scene) {
    refused = true;
    const bool splats_only = scene.error().code == base::ErrorCode::kUnsupported;
    session.refuse(scene.error().message, splats_only ? std::optional(Method::kQsplat) : std::nullopt);
    return true;
  }
  source = std::make_unique<StaticSource>(std::move(*scene), fetcher, parametersReader());
  return true;
}

PublishedSceneLink::PublishedSceneLink(const std::string& url, const LinkLimit& limit)
    : impl_(std::make_unique<Impl>(url, limit)) {}
PublishedSceneLink::~PublishedSceneLink() = default;

bool PublishedSceneLink::pump(Session& session) {
  Impl& s = *impl_;
  const bool came = s.source == nullptr && s.acceptScene(session);
  if (s.source == nullptr) return came;
  return s.source->pump(session, s.now()) || came;
}

void PublishedSceneLink::waitForArrival(double seconds) {
  impl_->fetcher.wait(seconds);
}

bool PublishedSceneLink::pick(std::uint32_t id, const glm::dvec3& origin, const glm::dvec3& direction) {
  if (impl_->source == nullptr) return false;
  impl_->source->pick(id, origin, direction);
  return true;
}

std::vector<AnsweredPick> PublishedSceneLink::takePicks() {
  return impl_->source == nullptr ? std::vector<AnsweredPick>() : impl_->source->takePicks();
}

LinkCounts PublishedSceneLink::counts() const {
  if (impl_->source == nullptr) return {1, 0};
  const StaticStats stats = impl_->source->stats();
  return {1 + stats.requests, impl_->scene_json.bytes() + stats.bytes};
}

}  // namespace client
