#include "server/net/hub.h"

#include <algorithm>
#include <utility>

#include "base/parallel.h"
#include "server/net/connection.h"
#include "server/net/scene_names.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

// A machine of one core has two workers, too, so that one that waits for a disk for a moment does not stop all.
constexpr unsigned kMinWorkers = 2;

base::Result<PageFiles> readPages(const std::string& directory) {
  if (directory.empty()) return PageFiles();
  return readPageFiles(directory);
}

/// Reports which published images cannot be read.
void reportImageErrors(OpenScene& scene) {
  if (scene.packs == nullptr) return;
  scene.packs->setErrorListener(
      [errors = scene.read_errors.get()](const base::Error& error) { errors->report("image", error); });
}

}  // namespace

Hub::Hub(boost::asio::io_context& context, ServerOptions chosen)
    : io(context),
      options(std::move(chosen)),
      held(std::make_shared<HeldMemory>(options.held_bytes)),
      workers(std::max(kMinWorkers, base::coreCount())) {
  metrics.all.read(Metrics::Kind::kGauge, "lumigrid_ready", "1 while new visitors are welcome, else 0.", {},
                   [this] { return isReady() ? 1.0 : 0.0; });
  metrics.readQueue("workers", [this] { return static_cast<double>(workers.waiting()); });
  metrics.readCache("messages",
                    [this] { return std::pair(message_lookups->hits.load(), message_lookups->misses.load()); });
  metrics.all.read(Metrics::Kind::kGauge, "lumigrid_held_bytes",
                   "Memory for what is remembered of the images that viewers hold.", {},
                   [this] { return static_cast<double>(held->bytes()); });
  metrics.all.read(Metrics::Kind::kCounter, "lumigrid_held_forgotten_total",
                   "Images that viewers hold and that were not remembered, for want of room.", {},
                   [this] { return static_cast<double>(held->forgotten()); });
  metrics.readQueue("fetchers", [this] {
    std::size_t waiting = 0;
    for (const auto& hosted : scenes) waiting += hosted->fetchers->waiting();
    return static_cast<double>(waiting);
  });
}

base::Result<void> Hub::openScenes(const std::vector<std::string>& places) {
  LUMIGRID_ASSIGN_OR_RETURN(pages, readPages(options.page_directory));
  LUMIGRID_ASSIGN_OR_RETURN(auto opened, openPlaces(places, {}));
  serveScenes(std::move(opened));
  return {};
}

base::Result<std::shared_ptr<HostedScene>> Hub::openPlace(const std::string& place, std::size_t scenes) const {
  RemoteOptions remote = options.remote;
  remote.warn = [](const std::string& message) { spdlog::warn("cache: {}", message); };
  LUMIGRID_ASSIGN_OR_RETURN(auto scene, openScene(place, remote));
  reportImageErrors(*scene);
  scene->data.ahead_bytes = options.ahead_bytes;
  scene->data.views_per_second = options.views_per_second;
  scene->data.held = held;
  scene->messages = std::make_unique<MessageCache>(options.message_cache_bytes / scenes, message_lookups);
  scene->data.messages = scene->messages.get();
  // The io thread must not wait for what the end of a scene waits for: its fetchers, its file of counts.
  const std::shared_ptr<HostedScene> hosted(
      new HostedScene(io, place, std::move(scene), pages),
      // Each is a group of its own, so that one whose end hangs does not keep others.
      [queue = disposer](HostedScene* ended) {
        const std::uint64_t group = ended->group;
        queue->setGroup(group, group);
        queue->submit(group, [held = std::shared_ptr<HostedScene>(ended), raw = queue.get()]() mutable {
          const std::uint64_t done = held->group;
          held.reset();
          raw->forget(done);
        });
      });
  return hosted;
}

base::Result<Hub::Scenes> Hub::openPlaces(const std::vector<std::string>& places, const Scenes& kept) const {
  if (places.empty()) return base::Error{base::ErrorCode::kInvalidInput, "there is no scene to serve"};
  if (places.size() > 1 && !options.access_file.empty())
    return base::Error{base::ErrorCode::kInvalidInput,
                       "one --access-file cannot keep the counts of several scenes; leave it out, or serve them apart"};
  if (const auto names = sceneNames(places); places.size() > 1 && !names) return names.error();
  Scenes opened;
  for (const std::string& place : places) {
    const auto known =
        std::find_if(kept.begin(), kept.end(), [&](const auto& hosted) { return hosted->place == place; });
    if (known != kept.end() && !isReplaced(*(*known)->scene, place)) {
      opened.push_back(*known);
      continue;
    }
    LUMIGRID_ASSIGN_OR_RETURN(auto hosted, openPlace(place, places.size()));
    opened.push_back(std::move(hosted));
  }
  return opened;
}

std::vector<std::string> Hub::accessNames(const Scenes& scenes) {
  std::vector<std::string> names;
  for (const auto& hosted : scenes) names.push_back(hosted->access_name);
  return names;
}

/// The files were read with the names of other scenes than those of now where two reloads overlap.
void Hub::takeSecurity(Security read) {
  read.scene_names = accessNames(scenes);
  security = std::make_shared<const Security>(std::move(read));
}

void Hub::serveScenes(Scenes opened, RendererPointer drawn_by) {
  const Scenes before = std::exchange(scenes, std::move(opened));
  std::vector<std::string> places;
  for (const auto& hosted : scenes) places.push_back(hosted->place);
  for (const auto& served : scenes) {
    HostedScene& hosted = *served;
    hosted.name = scenes.size() > 1 ? hosted.access_name : "";
    if (std::find(before.begin(), before.end(), served) != before.end()) continue;
    hosted.scene->read_errors->countIn(
        [&total = metrics.scene(hosted.scene->name).read_errors](std::uint64_t count) { total.add(count); });
    if (renderer && hosted.hasPatches()) renderer->addScene(hosted.scene);
    if (renderer) offerFrames(hosted);
    if (counts_access) hosted.startAccessLog(options);
  }
  if (places.size() == 1)
    root_place = places.front();
  else if (std::find(places.begin(), places.end(), root_place) == places.end())
    root_place.clear();
  if (drawn_by) takeRenderer(std::move(drawn_by));
  for (const auto& hosted : before)
    if (std::find(scenes.begin(), scenes.end(), hosted) == scenes.end()) endScene(hosted);
}

/// The scene itself lives until its last connection has gone.
void Hub::endScene(const std::shared_ptr<HostedScene>& hosted) {
  spdlog::info("scene {} is no longer served as it was", hosted->place);
  // A copy of the list, since closing may end a connection at once.
  std::vector<std::shared_ptr<Connection>> ended;
  for (Connection* connection : connections)
    if (connection->scene() == hosted.get()) ended.push_back(connection->shared_from_this());
  for (const auto& connection : ended) connection->closeForOtherScene();
  if (renderer) renderer->forgetScene(hosted->scene);
  std::erase_if(ended_scenes, [](const auto& one) { return one.expired(); });
  ended_scenes.push_back(hosted);
}

void Hub::startAccessLogs() {
  counts_access = true;
  for (const auto& hosted : scenes) hosted->startAccessLog(options);
}

void Hub::startRenderer() {
  draws_frames = true;
  std::vector<FrameRenderer::ScenePointer> drawn;
  for (const auto& hosted : scenes)
    if (hosted->hasPatches()) drawn.emplace_back(hosted->scene);
  if (drawn.empty()) return;
  if (auto made = makeRenderer(drawn)) takeRenderer(std::move(made));
}

Hub::RendererPointer Hub::makeRenderer(const std::vector<FrameRenderer::ScenePointer>& prepared) {
  auto started = FrameRenderer::start(prepared);
  if (started) return std::move(*started);
  spdlog::warn("no exact frames: {}", started.error().message);
  return nullptr;
}

void Hub::takeRenderer(RendererPointer made) {
  renderer = std::move(made);
  metrics.readQueue("frames", [this] { return static_cast<double>(renderer->counts().waiting_frames); });
  metrics.readQueue("pictures", [this] { return static_cast<double>(renderer->counts().waiting_pictures); });
  metrics.readCache("drawn frames", [this] {
    const FrameRenderer::Counts counts = renderer->counts();
    return std::pair(counts.found, counts.not_found);
  });
  for (const auto& hosted : scenes) {
    if (hosted->hasPatches()) renderer->addScene(hosted->scene);
    offerFrames(*hosted);
  }
}

void Hub::offerFrames(const HostedScene& hosted) {
  if (!hosted.hasPatches()) return;
  const bool lacks_textures = lacksTextures(*hosted.scene);
  if (lacks_textures)
    spdlog::warn("no exact frames of {}: it was published without its textures; publish it --with-textures",
                 hosted.place);
  const bool lacks_shadows = lacksShadows(*hosted.scene);
  if (lacks_shadows)
    spdlog::warn("no exact frames of {}: its light throws shadows, and its hlod.lgh cannot be had", hosted.place);
  hosted.scene->data.welcome.can_render_frames = !lacks_textures && !lacks_shadows;
  hosted.site->onLightChanged([this, scene = hosted.scene.get()](const base::Light& light) {
    if (renderer) renderer->setLight(scene->shared_from_this(), light);
  });
}

namespace {

/// Whether pages of the scene that were opened at "/" ask for this. A list of what there is, so that other names are
/// answered alike whether there is a scene of that name that the visitor may not see, or none.
bool isAskedAtRoot(const HostedScene& hosted, const RequestHead& request) {
  const std::string_view path = request.target.substr(0, request.target.find('?'));
  if (path == "/" || path == "/ws") return request.is_upgrade;
  return path == "/render" || path == "/pick" || hosted.site->hasFile(path);
}

}  // namespace

std::shared_ptr<HostedScene> Hub::findScene(const RequestHead& request, std::string_view& rest) const {
  const NamedTarget named = splitTarget(request.target);
  const bool is_only = scenes.size() == 1;
  const auto find = [&](const auto& is_wanted) {
    const auto found = std::find_if(scenes.begin(), scenes.end(), is_wanted);
    return found == scenes.end() ? nullptr : *found;
  };
  const auto at_root = find([&](const auto& hosted) { return hosted->place == root_place; });
  const auto below_name =
      find([&](const auto& hosted) { return !named.name.empty() && hosted->access_name == named.name; });
  const bool is_at_root = at_root != nullptr && isAskedAtRoot(*at_root, request);
  if (below_name != nullptr && !(is_only && is_at_root)) {
    rest = named.rest;
    return below_name;
  }
  rest = request.target;
  return is_only || is_at_root ? at_root : nullptr;
}

std::optional<HttpReply> Hub::answerForServer(const HttpRequest& request, const RequestHead& head) const {
  const std::string_view path = request.path();
  const bool is_known = path == "/healthz" || path == "/readyz" || path == "/metrics";
  if (!is_known || (request.method != "GET" && request.method != "HEAD")) return std::nullopt;
  HttpReply reply = textReply(200, "ok");
  if (path == "/readyz" && !isReady()) reply = tryLater(kRetrySeconds, "the server stops\n");
  if (path == "/metrics") {
    if (auto refused = security->refuseFigures(head, secondsNow())) return refused;
    reply.type = Metrics::kContentType;
    reply.text = metrics.all.text();
  }
  reply.cache = "no-store";
  return reply;
}

std::optional<HttpReply> Hub::answerInstead(const RequestHead& request, const HostedScene* hosted) const {
  std::optional<std::string_view> scene;
  if (hosted != nullptr)
    scene = hosted->access_name;
  else if (const NamedTarget named = splitTarget(request.target); !named.name.empty())
    scene = named.name;
  return security->answerInstead(request, scene, secondsNow());
}

HttpReply Hub::answerForAllScenes(const HttpRequest& request, const RequestHead& head) const {
  if (request.method == "OPTIONS") return preflightReply();
  if (request.method != "GET" && request.method != "HEAD") return methodNotAllowedReply();
  if (request.path() != "/") return textReply(404, "there is no such scene here; / lists them\n");
  std::vector<ListedScene> listed;
  for (const auto& hosted : scenes)
    if (security->opens(hosted->access_name, head, secondsNow()))
      listed.push_back({hosted->name, hosted->scene->scene.triangles});
  HttpReply reply = textReply(200, sceneListPage(listed, socketPlace(request, place)));
  reply.type = "text/html; charset=utf-8";
  return reply;
}

Hub::Scenes Hub::allScenes() const {
  Scenes all = scenes;
  for (const auto& one : ended_scenes)
    if (auto hosted = one.lock()) all.push_back(std::move(hosted));
  return all;
}

void Hub::endThreads(TimedTasks& ends) {
  stopping = true;
  ends.add("viewers' turns", [this] { workers.stop(); });
  ends.add("frames", [this] { renderer.reset(); });
  ends.add("scenes that were replaced", [this] { disposer->stop(); });
  for (const auto& hosted : allScenes())
    ends.add(hosted->place + " (" + std::to_string(hosted->group) + ")", [hosted] {
      hosted->fetchers->stop();
      hosted->picker.reset();
    });
}

void Hub::logReadErrors() const {
  for (const auto& hosted : scenes)
    if (const std::uint64_t count = hosted->scene->read_errors->count(); count > 0)
      spdlog::warn("{} reads{}{} failed since the server began", count, hosted->name.empty() ? "" : " of scene ",
                   hosted->name);
}

void Hub::endAccessLogs(TimedTasks& ends) const {
  for (const auto& hosted : allScenes())
    if (hosted->access)
      ends.add("access counts of " + hosted->place + " (" + std::to_string(hosted->group) + ")",
               [hosted] { hosted->access->finish(); });
}

}  // namespace server
