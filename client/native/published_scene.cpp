#include "client/native/published_scene.h"

#include <algorithm>
#include <chrono>
#include <optional>
#include <utility>

#include "base/parallel.h"
#include "client/native/connection.h"
#include "client/native/local_scene.h"
#include "client/source/streamed_hlod.h"
#include "client/source/streamed_splats.h"
#include "client/source/streamed_umbrellas.h"
#include "protocol/welcome.h"
#include "repository/sampling/parameters.h"

namespace client {
namespace {

constexpr std::uint64_t kMaxJsonBytes = std::uint64_t{16} << 20;
constexpr std::uint64_t kSceneJsonId = ~std::uint64_t{0};  // no id of a range

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

double secondsNow() {
  return std::chrono::duration<double>(LinkClock::Clock::now().time_since_epoch()).count();
}

}  // namespace

std::optional<StaticObject> objectOfPart(const base::Scene& scene, const std::string& stem,
                                         const std::string& extension) {
  const auto file = base::partFile(scene, stem, extension);
  if (!file) return std::nullopt;
  const auto part = std::find_if(scene.parts.begin(), scene.parts.end(),
                                 [&](const base::ScenePart& one) { return one.file == *file; });
  if (part == scene.parts.end()) return std::nullopt;
  return StaticObject{part->file, part->bytes, part->opening};
}

std::optional<StaticObject> objectOfMethod(const base::Scene& scene, Method method) {
  for (const base::StreamedMethod& streamed : base::kStreamedMethods)
    if (streamed.name == nameOf(method)) return objectOfPart(scene, streamed.name, streamed.extension);
  return std::nullopt;
}

std::optional<Method> streamedMethodOf(const base::Scene& scene) {
  for (const base::StreamedMethod& streamed : base::kStreamedMethods)
    if (base::partFile(scene, streamed.name, streamed.extension)) return methodFromName(streamed.name);
  return std::nullopt;
}

std::string lackOf(Method method) {
  const std::string name(nameOf(method));
  std::string file = name;
  for (const base::StreamedMethod& streamed : base::kStreamedMethods)
    if (streamed.name == name) file = streamed.file();
  return ": has no " + std::string(contentOf(method)) + " (" + file +
         "); build them with `lumigrid build ... --methods " + name + "`";
}

std::optional<Method> insteadOf(Method method, const base::Scene& scene, bool patches) {
  if (patches) return Method::kLumigraph;
  const std::optional<Method> other = streamedMethodOf(scene);
  return other != method ? other : std::nullopt;
}

base::Result<StaticScene> staticSceneFrom(const base::Scene& scene, const std::string& place) {
  const auto patches = objectOfPart(scene, "patch", ".lgp");
  if (const auto method = streamedMethodOf(scene); !patches && method)
    return base::Error{base::ErrorCode::kUnsupported, place + ": holds " + std::string(contentOf(*method)) +
                                                          " only; --method " + std::string(nameOf(*method)) +
                                                          " shows them"};
  if (!patches || !base::isPublishedName(patches->name))
    return base::Error{base::ErrorCode::kInvalidInput,
                       place + ": is not a published scene; put there what `lumigrid publish` wrote"};
  StaticScene out;
  out.place = place;
  out.patches = *patches;
  out.records = objectOfPart(scene, "records", ".lgr").value_or(StaticObject{});
  out.index = objectOfPart(scene, "images/index", ".lgi");
  out.welcome = protocol::welcomeOf(scene, nameOf(place, scene));
  return out;
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
  if (localSceneDirectory(url)) return {};
  if (!isPublishedScene(url)) {
    if (url.find("://") == std::string::npos && url.find_first_of("./") == 0)
      return base::Error{base::ErrorCode::kNotFound, "'" + url + "': no scene is there; it would hold a scene.json"};
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
  retry_at_ = now + backoff_.nextPause();
  return std::nullopt;
}

// ---- the link for patches and images ----

/// Opens the scene when scene.json has arrived.
bool PublishedSceneLink::acceptScene(Session& session, double now) {
  if (refused_) return false;
  const auto text = scene_json_.takeText(session, now);
  if (!text) return false;
  const auto scene = base::parseScene(*text, place_ + "/scene.json");
  auto files = scene ? staticSceneFrom(*scene, place_) : base::Result<StaticScene>(scene.error());
  if (!files) {
    refused_ = true;
    const bool has_patches = scene && objectOfPart(*scene, "patch", ".lgp");
    session.refuse(files.error().message, scene && !has_patches ? streamedMethodOf(*scene) : std::nullopt);
    return true;
  }
  source_.emplace(std::move(*files), fetcher_, [](const std::string& parameters) {
    return repository::sampledPointsFromMeta(parameters, "parameters");
  });
  return true;
}

bool PublishedSceneLink::pump(Session& session) {
  const double now = secondsNow();
  const bool came = !source_ && acceptScene(session, now);
  if (!source_) return came;
  return source_->pump(session, now) || came;
}

bool PublishedSceneLink::pick(std::uint32_t id, const glm::dvec3& origin, const glm::dvec3& direction) {
  if (!source_) return false;
  source_->pick(id, origin, direction);
  return true;
}

std::vector<AnsweredPick> PublishedSceneLink::takePicks() {
  return source_ ? source_->takePicks() : std::vector<AnsweredPick>();
}

LinkCounts PublishedSceneLink::counts() const {
  if (!source_) return {1, 0};
  const StaticStats stats = source_->stats();
  return {1 + stats.requests, scene_json_.bytes() + stats.bytes};
}

// ---- the link for streamed methods ----

namespace {

/// Reads the file of a streamed method at an HTTP address: scene.json names it, and the method's view reads it.
class FileLink final : public Link {
 public:
  /// `place` is the scene's URL; "http://host:port" of a server of ours is one, too.
  FileLink(const std::string& place, Method method, const LinkLimit& limit, const StreamedOptions& options,
           const HostAccess& access)
      : place_(place),
        method_(method),
        options_(options),
        fetcher_(std::make_unique<CurlFetcher>(place, limit, access)),
        connection_(fetcher_.get()),
        scene_json_(*fetcher_, place) {
    if (!options_.clock) options_.clock = secondsNow;
    options_.for_each = [](std::size_t count, const std::function<void(std::size_t)>& body) {
      base::parallelFor(count, 0, body);
    };
  }
  bool pump(Session& session) override;
  void waitForArrival(double seconds) override { connection_->wait(seconds); }
  LinkCounts counts() const override;
  std::shared_ptr<StreamedView> streamed() const override { return view_; }

 private:
  void acceptScene(const std::string& text, Session& session);

  const std::string place_;
  const Method method_;
  StreamedOptions options_;
  std::unique_ptr<CurlFetcher> fetcher_;  // until the view takes it over
  CurlFetcher* connection_;               // the same fetcher, whoever owns it
  SceneJson scene_json_;
  bool refused_ = false;
  std::shared_ptr<StreamedView> view_;
};

void FileLink::acceptScene(const std::string& text, Session& session) {
  const auto scene = base::parseScene(text, place_ + "/scene.json");
  const auto part = scene ? objectOfMethod(*scene, method_) : std::nullopt;
  if (!part) {
    refused_ = true;
    if (!scene) return session.refuse(scene.error().message);
    return session.refuse(place_ + lackOf(method_),
                          insteadOf(method_, *scene, objectOfPart(*scene, "patch", ".lgp").has_value()));
  }
  protocol::Welcome welcome = protocol::welcomeOf(*scene, nameOf(place_, *scene));
  welcome.has_colors = scene->has_colors;
  const FilePlace place{place_, part->name, part->bytes};
  if (method_ == Method::kHlod)
    view_ = std::make_shared<StreamedHlod>(place, welcome, std::move(fetcher_), options_);
  else if (method_ == Method::kPmr)
    view_ = std::make_shared<StreamedUmbrellas>(place, welcome, std::move(fetcher_), options_);
  else
    view_ = std::make_shared<StreamedSplats>(place, welcome, std::move(fetcher_), options_);
}

bool FileLink::pump(Session& session) {
  if (refused_) return false;
  if (view_) return view_->pump(session, secondsNow());
  const auto text = scene_json_.takeText(session, secondsNow());
  if (text) acceptScene(*text, session);
  return text.has_value();
}

LinkCounts FileLink::counts() const {
  if (!view_) return {1, scene_json_.bytes()};
  const StreamedStats stats = view_->stats();
  return {1 + stats.requests, scene_json_.bytes() + stats.bytes_received};
}

}  // namespace

// ---- any link ----

base::Result<std::unique_ptr<Link>> openLink(const std::string& url, const LinkLimit& limit, const HostAccess& access) {
  if (const auto directory = localSceneDirectory(url)) return openLocalScene(*directory);
  if (isPublishedScene(url)) return std::unique_ptr<Link>(std::make_unique<PublishedSceneLink>(url, limit, access));
  LUMIGRID_ASSIGN_OR_RETURN(auto server, parseServerUrl(url));
  return std::unique_ptr<Link>(std::make_unique<Connection>(server, limit, access));
}

base::Result<std::unique_ptr<Link>> openStreamedLink(const std::string& url, Method method, const LinkLimit& limit,
                                                     const StreamedOptions& options, const HostAccess& access) {
  LUMIGRID_TRY(checkUrl(url));
  if (const auto directory = localSceneDirectory(url)) return openLocalFile(*directory, method, options);
  if (isPublishedScene(url))
    return std::unique_ptr<Link>(std::make_unique<FileLink>(placeOfScene(url), method, limit, options, access));
  LUMIGRID_ASSIGN_OR_RETURN(const auto server, parseServerUrl(url));
  // A server with several scenes has each in a folder of its own.
  const std::string place = placeOfScene(server.httpPlace() + server.target);
  return std::unique_ptr<Link>(std::make_unique<FileLink>(place, method, limit, options, access));
}

}  // namespace client
