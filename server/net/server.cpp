// gcc 12 needs <utility> before Boost 1.74's Asio (std::exchange).
#include <utility>
//
// The only translation unit of the server that sees Asio and Beast: it costs more to compile than the rest of server/.
#include <netinet/tcp.h>
#include <sys/socket.h>

#include <boost/asio/basic_socket_acceptor.hpp>
#include <boost/asio/basic_waitable_timer.hpp>
#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/beast/core/basic_stream.hpp>
#include <boost/beast/core/bind_handler.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <mutex>
#include <optional>
#include <set>
#include <string_view>
#include <utility>

#include "base/parallel.h"
#include "server/net/access_log.h"
#include "server/net/frame_renderer.h"
#include "server/net/open_scene.h"
#include "server/net/pick.h"
#include "server/net/scene_names.h"
#include "server/net/server.h"
#include "server/net/site.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using boost::system::error_code;
using Tcp = asio::ip::tcp;
using Executor = asio::io_context::executor_type;  // the concrete type: any_io_executor compiles and runs slower
using Acceptor = asio::basic_socket_acceptor<Tcp, Executor>;
using Socket = asio::basic_stream_socket<Tcp, Executor>;
using Stream = beast::basic_stream<Tcp, Executor>;
using Clock = std::chrono::steady_clock;
using Timer = asio::basic_waitable_timer<Clock, asio::wait_traits<Clock>, Executor>;

constexpr auto kHttpIdle = std::chrono::seconds(30);
constexpr auto kHandshake = std::chrono::seconds(30);
constexpr auto kGoodbye = std::chrono::seconds(2);  // what viewers get to close when the server stops
constexpr auto kAcceptPause =
    std::chrono::milliseconds(100);  // after an accept that failed, e.g. for want of descriptors
constexpr std::uint64_t kSlowestBytesPerSecond = 16 * 1024;  // a slower HTTP download is cut
constexpr std::uint32_t kHeaderLimit = 8 * 1024;
constexpr auto kPatience = std::chrono::minutes(10);  // for a picture or a picked point
constexpr int kRetrySeconds = 5;
constexpr std::size_t kMaxUnsentPictures = std::size_t{256} << 20;  // bytes; beyond, no further one is begun
constexpr std::uint32_t kTurnedAway = 64;                           // connections over the limit that still get a 503
constexpr unsigned kFetchers = 8;  // views whose far images are fetched at a time, or pieces of files
constexpr std::uint64_t kFarPiece = std::uint64_t{1} << 20;  // bytes of a far file that a connection holds

class Connection;

/// One scene, and who answers for it.
struct Hosted {
  Hosted(std::size_t place_in_list, std::string served_as, std::unique_ptr<OpenScene> opened)
      : number(place_in_list), name(std::move(served_as)), scene(std::move(opened)) {}

  const std::size_t number;  // the renderer knows it by that
  const std::string name;    // empty: the only one, at "/"
  std::unique_ptr<OpenScene> scene;
  std::unique_ptr<Site> site;
  std::unique_ptr<Picker> picker;     // null: the scene has splats alone
  std::unique_ptr<AccessLog> access;  // null: nothing is counted

  bool hasPatches() const { return scene->data.patches != nullptr; }
  void countAccess(const ServerOptions& options, const std::string& scene_directory);
};

/// What all connections share. One thread (the io thread) uses it, but for the renderer, which has its own lock.
struct Hub {
  Hub(asio::io_context& context, ServerOptions chosen) : io(context), options(std::move(chosen)) {}

  asio::io_context& io;
  ServerOptions options;
  std::vector<std::unique_ptr<Hosted>> scenes;  // at least one
  std::unique_ptr<FrameRenderer> renderer;      // null: no exact frames
  std::unique_ptr<base::ThreadPool> fetchers;   // of far images and splats; null: all are here
  std::string place;                            // address:port
  std::set<Connection*> connections;
  std::uint64_t next_client = 1;
  std::size_t viewers = 0;
  std::size_t unsent_picture_bytes = 0;  // rendered, and not yet all taken by their connections
  std::atomic<bool> stopping = false;    // the fetchers look too
  std::optional<Timer> goodbye;

  base::Result<void> open(const std::vector<std::string>& places);
  base::Result<void> makeSites();
  void startFetchers();
  void startRenderer();
  /// The scene that a target is about, and what is asked of it; null: none, or the list of them.
  Hosted* find(std::string_view target, std::string_view& rest) const;
  HttpReply answerForAll(const HttpRequest& request) const;
  /// Their threads post to `io`, which goes last.
  void endThreads() {
    stopping = true;
    fetchers.reset();
    renderer.reset();
    for (const auto& hosted : scenes) hosted->picker.reset();
  }
  /// Writes what was counted; from here on nothing is.
  void keepAccess() {
    for (const auto& hosted : scenes) {
      hosted->scene->data.access = nullptr;
      hosted->access.reset();
    }
  }
};

void Hosted::countAccess(const ServerOptions& options, const std::string& scene_directory) {
  if (!hasPatches()) return;  // images and groups are what is counted
  std::string path = options.access_file;
  std::error_code ignored;
  if (path.empty()) {
    if (!std::filesystem::is_directory(scene_directory, ignored)) {
      spdlog::warn("access counts are not kept: {} is no directory; --access-file names a place for them",
                   scene_directory);
      return;
    }
    path = repository::accessFileOf(scene_directory);
  }
  access = std::make_unique<AccessLog>(path, accessIdentityOf(*scene), options.access_interval_seconds);
  scene->data.access = &access->counter();
}

constexpr std::size_t kMaxToldErrors = 100;

// What of published images cannot be read, each thing once: a missing pack holds hundreds of faces, and viewers ask for
// them again and again.
void logImageErrors(OpenScene& scene) {
  if (scene.packs == nullptr) return;
  struct Told {
    std::mutex mutex;
    std::set<std::string> messages;
  };
  scene.packs->setErrorListener([told = std::make_shared<Told>()](const base::Error& error) {
    const std::lock_guard guard(told->mutex);
    if (told->messages.size() < kMaxToldErrors && told->messages.insert(error.message).second)
      spdlog::warn("image: {}", error.message);
  });
}

base::Result<void> Hub::open(const std::vector<std::string>& places) {
  if (places.empty()) return base::Error{base::ErrorCode::kInvalidInput, "there is no scene to serve"};
  if (places.size() > 1 && !options.access_file.empty())
    return base::Error{base::ErrorCode::kInvalidInput,
                       "one --access-file cannot keep the counts of several scenes; leave it out, or serve them apart"};
  auto names = namesOf(places);
  if (places.size() > 1 && !names) return names.error();
  RemoteOptions remote = options.remote;
  remote.warn = [](const std::string& what) { spdlog::warn("cache: {}", what); };
  for (std::size_t i = 0; i < places.size(); ++i) {
    LUMIGRID_ASSIGN_OR_RETURN(auto scene, openScene(places[i], remote));
    logImageErrors(*scene);
    scene->data.ahead_bytes = options.ahead_bytes;
    scenes.push_back(std::make_unique<Hosted>(i, places.size() > 1 ? (*names)[i] : "", std::move(scene)));
  }
  return {};
}

base::Result<void> Hub::makeSites() {
  PageFiles pages;
  if (!options.page_directory.empty()) {
    LUMIGRID_ASSIGN_OR_RETURN(auto read, readPageFiles(options.page_directory));
    pages = std::move(read);
  }
  for (const auto& hosted : scenes) {
    hosted->site = std::make_unique<Site>(*hosted->scene, pages);
    if (hosted->hasPatches()) hosted->picker = std::make_unique<Picker>(hosted->scene->scene, hosted->scene->patches);
  }
  return {};
}

/// Each viewer has two requests at most, other connections one, so nobody waits to put one in.
void Hub::startFetchers() {
  const bool far = std::any_of(scenes.begin(), scenes.end(), [](const auto& hosted) {
    return hosted->scene->data.images_are_far || hosted->scene->far_splats != nullptr;
  });
  if (!far) return;
  fetchers = std::make_unique<base::ThreadPool>(kFetchers,
                                                std::size_t{2} * (options.max_connections + kTurnedAway) + kFetchers);
}

void Hub::startRenderer() {
  std::vector<const OpenScene*> opened;
  for (const auto& hosted : scenes) opened.push_back(hosted->scene.get());
  if (std::none_of(scenes.begin(), scenes.end(), [](const auto& hosted) { return hosted->hasPatches(); })) return;
  auto started = FrameRenderer::start(opened);
  if (!started) return spdlog::warn("no exact frames: {}", started.error().message);
  renderer = std::move(*started);
  for (const auto& hosted : scenes) hosted->scene->data.welcome.can_render_frames = hosted->hasPatches();
}

Hosted* Hub::find(std::string_view target, std::string_view& rest) const {
  if (scenes.size() == 1) {
    rest = target;
    return scenes.front().get();
  }
  const NamedTarget named = splitTarget(target);
  rest = named.rest;
  for (const auto& hosted : scenes)
    if (hosted->name == named.name) return hosted.get();
  return nullptr;
}

/// What no single scene answers, where there are several.
HttpReply Hub::answerForAll(const HttpRequest& request) const {
  if (request.method != "GET" && request.method != "HEAD") return textReply(405, "only GET and HEAD\n");
  if (request.path() == "/healthz") return textReply(200, "ok");
  if (request.path() != "/") return textReply(404, "there is no such scene here; / lists them\n");
  std::vector<ListedScene> listed;
  for (const auto& hosted : scenes) listed.push_back({hosted->name, hosted->scene->scene.triangles});
  HttpReply reply = textReply(200, sceneList(listed, shownHost(request.host, place)));
  reply.type = "text/html; charset=utf-8";
  return reply;
}

/// Anything with a socket. Alive as long as an operation of it is pending.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  explicit Connection(std::shared_ptr<Hub> hub) : hub_(std::move(hub)) { hub_->connections.insert(this); }
  virtual ~Connection() {
    hub_->connections.erase(this);
    if (hub_->stopping && hub_->connections.empty() && hub_->goodbye) hub_->goodbye->cancel();
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;
  /// The server stops: say so and go.
  virtual void leave() = 0;

 protected:
  template <class Self>
  std::shared_ptr<Self> self() {
    return std::static_pointer_cast<Self>(shared_from_this());
  }
  const std::shared_ptr<Hub> hub_;
};

// ---------------------------------------------------------------------------------------------------------------------
// A viewer: one WebSocket, one Session. Reads and writes run side by side; a message is chosen when the one before it
// was taken.

class Viewer final : public Connection {
 public:
  Viewer(std::shared_ptr<Hub> hub, const Hosted& hosted, Stream&& stream)
      : Connection(std::move(hub)),
        hosted_(hosted),
        id_(hub_->next_client++),
        socket_(std::move(stream)),
        session_(hosted.scene->data) {
    error_code ignored;
    const auto endpoint = beast::get_lowest_layer(socket_).socket().remote_endpoint(ignored);
    ++hub_->viewers;
    peer_ = endpoint.address().to_string() + ":" + std::to_string(endpoint.port());
  }
  ~Viewer() override {
    if (hub_->renderer) hub_->renderer->cancel(id_);
    --hub_->viewers;
    const SessionCounts& counts = session_.counts();
    spdlog::info(
        "disconnect client={} peer={} seconds={:.1f} views={} groups={} faces={} frames={} bytes={} missing={} "
        "corrupt={} why=\"{}\"",
        id_, peer_, std::chrono::duration<double>(Clock::now() - since_).count(), counts.views, counts.groups,
        counts.faces, counts.frames, counts.bytes, counts.missing, counts.corrupt, why_);
  }

  void start(const http::request<http::empty_body>& request) {
    spdlog::info("connect client={} peer={} viewers={}{}{}", id_, peer_, hub_->viewers,
                 hosted_.name.empty() ? "" : " scene=", hosted_.name);
    prepareSocket();
    websocket::stream_base::timeout timeout;
    timeout.handshake_timeout = kHandshake;
    timeout.idle_timeout =
        std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(hub_->options.idle_seconds));
    timeout.keep_alive_pings = true;
    socket_.set_option(timeout);
    socket_.set_option(
        websocket::stream_base::decorator([](websocket::response_type& r) { r.set(http::field::server, "lumigrid"); }));
    socket_.read_message_max(protocol::kMaxClientMessage);
    socket_.binary(true);
    socket_.auto_fragment(false);
    socket_.async_accept(request, beast::bind_front_handler(&Viewer::onAccept, self<Viewer>()));
  }

  void leave() override { close(websocket::close_code::going_away, "the server stops"); }

 private:
  /// Small messages go at once, and little waits in the kernel: a byte there can no longer give way to a newer view's.
  void prepareSocket() {
    auto& socket = beast::get_lowest_layer(socket_).socket();
    error_code ignored;
    socket.set_option(Tcp::no_delay(true), ignored);
    const int unsent = static_cast<int>(std::clamp<std::uint64_t>(hub_->options.max_unsent_bytes, 4096, 1 << 30));
    ::setsockopt(socket.native_handle(), IPPROTO_TCP, TCP_NOTSENT_LOWAT, &unsent, sizeof unsent);
  }

  void onAccept(error_code ec) {
    if (ec) return fail("handshake", ec);
    doRead();
  }

  void doRead() { socket_.async_read(incoming_, beast::bind_front_handler(&Viewer::onRead, self<Viewer>())); }

  void onRead(error_code ec, std::size_t) {
    if (ec) return fail("read", ec);
    if (closing_ || refused_) {
      // Until the peer's close frame; what else it says is of no interest.
      incoming_.clear();
      return doRead();
    }
    if (!socket_.got_binary()) return close(websocket::close_code::unknown_data, "messages are binary");

    const auto bytes = incoming_.cdata();
    const auto taken = session_.receive({static_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
    if (!taken) {
      refused_ = true;
      why_ = taken.error().message;
      spdlog::warn("refuse client={} peer={} why=\"{}\"", id_, peer_, why_);
    } else if (!named_ && !session_.clientName().empty()) {
      named_ = true;
      spdlog::info("hello client={} program=\"{}\"", id_, session_.clientName());
    }
    incoming_.clear();
    doWrite();
    doRead();
  }

  void doWrite() {
    if (writing_ || closing_) return;
    outgoing_ = session_.nextMessage();
    while (auto request = session_.takeFaceRequest()) askForFaces(std::move(*request));
    if (outgoing_) {
      writing_ = true;
      socket_.async_write(asio::buffer(*outgoing_), beast::bind_front_handler(&Viewer::onWrite, self<Viewer>()));
    } else if (session_.finished()) {
      close(websocket::close_code::policy_error, why_);
    } else if (auto request = session_.takeFrameRequest()) {
      askForFrame(*request);
    }
  }

  void onWrite(error_code ec, std::size_t) {
    writing_ = false;
    if (ec) return fail("write", ec);
    doWrite();
  }

  /// All faces of a request at once, so that neighbours come by one range. Whoever waits for a network is not this
  /// thread.
  void askForFaces(FaceRequest request) {
    hub_->fetchers->submit([weak = weak_from_this(), hub = hub_.get(), images = hosted_.scene->images.get(),
                            request = std::move(request)] {
      if (hub->stopping) return;
      asio::post(hub->io, [weak, request, values = images->getMany(request)]() mutable {
        if (auto viewer = std::static_pointer_cast<Viewer>(weak.lock())) viewer->onFaces(request, std::move(values));
      });
    });
  }

  void onFaces(const FaceRequest& request, Session::FaceValues values) {
    session_.facesFetched(request, std::move(values));
    doWrite();
  }

  /// The renderer answers on its own thread; the answer comes back to this one, where the viewer may be gone.
  void askForFrame(const FrameRequest& request) {
    if (!hub_->renderer) return;
    std::weak_ptr<Connection> weak = weak_from_this();
    hub_->renderer->submit(id_, hosted_.number, request, [weak, request, &io = hub_->io](base::Bytes value) {
      asio::post(io, [weak, request, value = std::move(value)]() mutable {
        if (auto viewer = std::static_pointer_cast<Viewer>(weak.lock())) viewer->onFrame(request, std::move(value));
      });
    });
  }

  void onFrame(const FrameRequest& request, base::Bytes value) {
    session_.frameRendered(request, std::move(value));
    doWrite();
  }

  void close(websocket::close_code code, const std::string& reason) {
    if (closing_) return;
    closing_ = true;
    if (why_.empty()) why_ = reason;
    websocket::close_reason close_reason(code);
    close_reason.reason.assign(reason.data(), std::min<std::size_t>(reason.size(), 120));
    socket_.async_close(close_reason, beast::bind_front_handler(&Viewer::onClose, self<Viewer>()));
  }

  void onClose(error_code ec) {
    if (ec) fail("close", ec);
  }

  void fail(const char* where, error_code ec) {
    if (why_.empty())
      why_ = ec == websocket::error::closed ? "the viewer left" : std::string(where) + ": " + ec.message();
    closing_ = true;
    // Ends what is still pending, so that the viewer goes.
    beast::get_lowest_layer(socket_).close();
  }

  const Hosted& hosted_;
  const std::uint64_t id_;
  const Clock::time_point since_ = Clock::now();
  websocket::stream<Stream, false> socket_;
  Session session_;
  std::string peer_;
  std::string why_;
  beast::flat_buffer incoming_;
  std::optional<base::Bytes> outgoing_;
  bool writing_ = false;
  bool closing_ = false;
  bool refused_ = false;
  bool named_ = false;
};

// ---------------------------------------------------------------------------------------------------------------------
// Plain HTTP: what the site answers at once, what others answer later; or the upgrade to a viewer.

class HttpConnection final : public Connection {
 public:
  HttpConnection(std::shared_ptr<Hub> hub, Socket&& socket, bool turned_away)
      : Connection(std::move(hub)), stream_(std::move(socket)), turned_away_(turned_away) {}

  ~HttpConnection() override { hub_->unsent_picture_bytes -= held_bytes_; }

  void start() { doRead(); }
  void leave() override {
    stopWaiting();
    stream_.close();
  }

 private:
  void doRead() {
    parser_.emplace();
    parser_->header_limit(kHeaderLimit);
    parser_->body_limit(0);
    stream_.expires_after(kHttpIdle);
    http::async_read(stream_, buffer_, *parser_,
                     beast::bind_front_handler(&HttpConnection::onRead, self<HttpConnection>()));
  }

  void onRead(error_code ec, std::size_t) {
    if (ec == http::error::end_of_stream) return finish();
    if (ec) return;  // a timeout, a lost peer or no HTTP at all: the socket closes with this
    HttpRequest request = requestOf(parser_->get());
    if (turned_away_)
      return doWrite(tryLater(kRetrySeconds, "this server has as many viewers as it may; try again later\n"));
    std::string_view rest;
    hosted_ = hub_->find(request.target, rest);
    if (hosted_ == nullptr) return doWrite(hub_->answerForAll(request));
    if (rest.empty()) return doWrite(movedInto(hosted_->name));
    request.target = rest;
    const std::string_view path = request.path();
    if (websocket::is_upgrade(parser_->get()) && (path == "/" || path == "/ws")) return becomeViewer();
    const bool reads = request.method == "GET" || request.method == "HEAD";
    const bool needs_patches = reads && (path == "/render" || path == "/pick");
    if (needs_patches && !hosted_->hasPatches()) return doWrite(splatsOnlyReply());
    if (reads && path == "/render") return askForPicture(request);
    if (reads && path == "/pick") return askForPick(request);
    HttpReply reply = hosted_->site->answer(request, hub_->place);
    if (reply.far.length > 0 && request.method != "HEAD") return askForPiece(std::move(reply));
    doWrite(std::move(reply));
  }

  /// What the page asks for is relative to its folder.
  static HttpReply movedInto(const std::string& name) {
    HttpReply reply = textReply(301, "see /" + name + "/\n");
    reply.headers.emplace_back("Location", "/" + name + "/");
    return reply;
  }

  static HttpRequest requestOf(const http::request<http::empty_body>& request) {
    const auto view = [](beast::string_view text) { return std::string_view(text.data(), text.size()); };
    return {view(request.method_string()),
            view(request.target()),
            view(request[http::field::host]),
            view(request[http::field::range]),
            view(request[http::field::if_range]),
            view(request[http::field::if_none_match]),
            view(request[http::field::accept_encoding])};
  }

  void becomeViewer() {
    stream_.expires_never();  // the WebSocket has its own timeouts
    auto viewer = std::make_shared<Viewer>(hub_, *hosted_, std::move(stream_));
    viewer->start(parser_->get());
  }

  // ---- Answers that others work out on their own threads

  void askForPicture(const HttpRequest& request) {
    const std::uint64_t most = hub_->options.max_picture_pixels;
    if (!hub_->renderer || most == 0)
      return doWrite(textReply(501, "this server renders no pictures; they need frames and --max-picture above 0\n"));
    const auto query = parseQuery(request.target);
    if (!query) return doWrite(badRequest(query.error()));
    const auto picture = parsePictureRequest(*query, most);
    if (!picture) return doWrite(badRequest(picture.error()));
    const std::string type = contentTypeOf(picture->format);
    if (request.method == "HEAD") return doWrite(headOnly(type));

    const auto done = [this](std::uint64_t id, const std::string& content_type) {
      return [weak = weak_from_this(), id, content_type, &io = hub_->io](base::Result<base::Bytes> bytes) {
        asio::post(io, [weak, id, content_type, bytes = std::move(bytes)]() mutable {
          if (auto self = std::static_pointer_cast<HttpConnection>(weak.lock()))
            self->onPicture(id, content_type, std::move(bytes));
        });
      };
    };
    const std::uint64_t id = hub_->next_client++;
    const bool taken =
        hub_->unsent_picture_bytes < kMaxUnsentPictures &&
        hub_->renderer->paint(id, hosted_->number, *picture, hub_->options.max_waiting_pictures, done(id, type));
    if (!taken) return doWrite(tryLater(kRetrySeconds, "too many pictures are asked for at once; try again later\n"));
    wait(id);
  }

  void onPicture(std::uint64_t id, const std::string& type, base::Result<base::Bytes> bytes) {
    if (waiting_ != id) return;
    stopWaiting();
    if (!bytes) return doWrite(textReply(500, "the picture could not be rendered; the server's log says why\n"));
    HttpReply reply;
    reply.type = type;
    reply.cache = "no-store";
    reply.owned = std::move(*bytes);
    held_bytes_ = reply.owned.size();
    hub_->unsent_picture_bytes += held_bytes_;
    doWrite(std::move(reply));
  }

  void askForPick(const HttpRequest& request) {
    const auto query = parseQuery(request.target);
    if (!query) return doWrite(badRequest(query.error()));
    const auto ray = parsePickRequest(*query);
    if (!ray) return doWrite(badRequest(ray.error()));
    if (request.method == "HEAD") return doWrite(headOnly("application/json"));
    const std::uint64_t id = hub_->next_client++;
    const bool taken =
        hosted_->picker->submit(*ray, [weak = weak_from_this(), id, &io = hub_->io](base::Result<std::string> json) {
          asio::post(io, [weak, id, json = std::move(json)]() mutable {
            if (auto self = std::static_pointer_cast<HttpConnection>(weak.lock())) self->onPick(id, std::move(json));
          });
        });
    if (!taken) return doWrite(tryLater(1, "too many points are asked for at once; try again later\n"));
    wait(id);
  }

  void onPick(std::uint64_t id, base::Result<std::string> json) {
    if (waiting_ != id) return;
    stopWaiting();
    if (!json) {
      spdlog::warn("pick: {}", json.error().message);
      return doWrite(textReply(500, "the scene's data is damaged there; the server's log says more\n"));
    }
    HttpReply reply = textReply(200, std::move(*json));
    reply.type = "application/json";
    reply.cache = "no-store";
    doWrite(std::move(reply));
  }

  static HttpReply headOnly(const std::string& type) {
    HttpReply reply;
    reply.type = type;
    reply.cache = "no-store";
    reply.has_length = false;
    return reply;
  }

  /// Until the answer comes, the visitor leaves or patience ends.
  void wait(std::uint64_t id) {
    waiting_ = id;
    stream_.expires_never();
    patience_.emplace(hub_->io, kPatience);
    patience_->async_wait([self = self<HttpConnection>(), id](error_code cancelled) {
      if (!cancelled) self->onImpatience(id);
    });
    // Readable while nothing was asked: the visitor closed, or asks the next thing already, which can wait.
    stream_.socket().async_wait(Socket::wait_read, [self = self<HttpConnection>(), id](error_code cancelled) {
      if (!cancelled) self->onReadable(id);
    });
  }

  void onImpatience(std::uint64_t id) {
    if (waiting_ != id) return;
    stopWaiting();
    if (far_begun_) return leave();
    doWrite(tryLater(kRetrySeconds, "this takes too long; ask for fewer pixels or try again later\n"));
  }

  void onReadable(std::uint64_t id) {
    error_code ec;
    if (waiting_ != id || (stream_.socket().available(ec) != 0 && !ec)) return;
    leave();
  }

  void stopWaiting() {
    if (!waiting_) return;
    if (hub_->renderer) hub_->renderer->cancel(*waiting_);
    waiting_.reset();
    patience_->cancel();
    error_code ignored;
    stream_.socket().cancel(ignored);
  }

  // ---- Bodies that lie behind a network: a piece is read on another thread, then sent; head and errors go with the
  // first

  void askForPiece(HttpReply reply) {
    reply_ = std::move(reply);
    readPiece();
  }

  void readPiece() {
    const FarBody& far = reply_.far;
    const std::uint64_t id = hub_->next_client++;
    hub_->fetchers->submit([weak = weak_from_this(), id, hub = hub_.get(), source = far.source, name = far.name,
                            offset = far.offset, length = std::min(far.length, kFarPiece)] {
      if (hub->stopping) return;
      asio::post(hub->io, [weak, id, piece = source->read(name, offset, length)]() mutable {
        if (auto self = std::static_pointer_cast<HttpConnection>(weak.lock())) self->onPiece(id, std::move(piece));
      });
    });
    wait(id);
  }

  void onPiece(std::uint64_t id, base::Result<base::Bytes> piece) {
    if (waiting_ != id) return;
    stopWaiting();
    if (!piece) {
      spdlog::warn("far file: {}", piece.error().message);
      return far_begun_ ? leave() : doWrite(farFault(piece.error()));
    }
    reply_.owned = std::move(*piece);
    if (!std::exchange(far_begun_, true)) return doWrite(std::move(reply_));
    writePiece();
  }

  static HttpReply farFault(const base::Error& error) {
    const std::string text = "this file cannot be read where the scene lies; the server's log says why\n";
    return error.code == base::ErrorCode::kNetwork ? tryLater(kRetrySeconds, text) : textReply(502, text);
  }

  void onHead(error_code ec, std::size_t) {
    if (ec) return onWrite(ec, 0);
    writePiece();
  }

  void writePiece() {
    expireAfter(reply_.owned.size());
    asio::async_write(stream_, asio::buffer(reply_.owned),
                      beast::bind_front_handler(&HttpConnection::onPieceWritten, self<HttpConnection>()));
  }

  void onPieceWritten(error_code ec, std::size_t bytes) {
    FarBody& far = reply_.far;
    far.offset += bytes;
    far.length -= bytes;
    if (ec || far.length == 0) return onWrite(ec, 0);
    readPiece();
  }

  // ---- Writing

  void doWrite(HttpReply reply) {
    const auto& request = parser_->get();
    reply_ = std::move(reply);
    response_.emplace();
    setFields(request);
    const bool is_far = reply_.far.length > 0;
    const base::ByteView body = is_far ? base::ByteView() : reply_.body();
    response_->body() = {body.data(), body.size()};
    const bool bodiless = reply_.status == 204 || reply_.status == 304;
    if (reply_.has_length && !bodiless) response_->content_length(is_far ? reply_.far.length : body.size());

    expireAfter(body.size());
    serializer_.emplace(*response_);
    if (far_begun_)
      return http::async_write_header(stream_, *serializer_,
                                      beast::bind_front_handler(&HttpConnection::onHead, self<HttpConnection>()));
    auto handler = beast::bind_front_handler(&HttpConnection::onWrite, self<HttpConnection>());
    if (request.method() == http::verb::head)
      return http::async_write_header(stream_, *serializer_, std::move(handler));
    http::async_write(stream_, *serializer_, std::move(handler));
  }

  /// With so many bytes in hand.
  void expireAfter(std::size_t bytes) {
    stream_.expires_after(kHttpIdle + std::chrono::seconds(bytes / kSlowestBytesPerSecond));
  }

  void setFields(const http::request<http::empty_body>& request) {
    auto& fields = *response_;
    fields.result(static_cast<unsigned>(reply_.status));
    fields.version(request.version());
    fields.keep_alive(request.keep_alive() && !turned_away_ && !hub_->stopping && reply_.has_length);
    fields.set(http::field::server, "lumigrid");
    fields.set(http::field::content_type, reply_.type);
    fields.set(http::field::cache_control, reply_.cache);
    fields.set("X-Content-Type-Options", "nosniff");
    // Any page may read what anybody may fetch: scenes on a server without tokens are public.
    fields.set(http::field::access_control_allow_origin, "*");
    fields.set(http::field::access_control_expose_headers,
               "Accept-Ranges, Content-Length, Content-Range, ETag, Retry-After");
    fields.set("Cross-Origin-Resource-Policy", "cross-origin");
    for (const auto& [name, value] : reply_.headers) fields.set(name, value);
  }

  void onWrite(error_code ec, std::size_t) {
    hub_->unsent_picture_bytes -= std::exchange(held_bytes_, 0);
    reply_ = {};
    far_begun_ = false;
    if (ec) return;
    if (!response_->keep_alive()) return finish();
    doRead();
  }

  void finish() {
    error_code ignored;
    stream_.socket().shutdown(Tcp::socket::shutdown_send, ignored);
  }

  using Body = http::span_body<const std::uint8_t>;
  Stream stream_;
  const bool turned_away_;
  Hosted* hosted_ = nullptr;  // that the request in hand is about
  beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::empty_body>> parser_;
  std::optional<std::uint64_t> waiting_;  // for this answer
  std::optional<Timer> patience_;
  std::size_t held_bytes_ = 0;  // of a picture
  bool far_begun_ = false;      // the head of reply_.far's body is said
  HttpReply reply_;
  std::optional<http::response<Body>> response_;
  std::optional<http::response_serializer<Body>> serializer_;
};

base::Error bindError(const std::string& address, std::uint16_t port, error_code ec) {
  const std::string place = address + ":" + std::to_string(port);
  if (ec == asio::error::address_in_use)
    return {base::ErrorCode::kNetwork, place + " is in use; choose another port with --port (0 picks a free one)"};
  if (ec == asio::error::access_denied)
    return {base::ErrorCode::kNetwork,
            place + ": not allowed; ports below 1024 need privileges, choose another with --port"};
  return {base::ErrorCode::kNetwork,
          "cannot listen at " + place + ": " + ec.message() + "; choose another address with --address"};
}

}  // namespace

// ---------------------------------------------------------------------------------------------------------------------

struct Server::State {
  asio::io_context io{1};
  std::shared_ptr<Hub> hub;
  Acceptor acceptor{io};
  Socket incoming{io};
  Timer pause{io};
  std::optional<asio::basic_signal_set<Executor>> signals;

  ~State() {
    if (!hub) return;
    hub->endThreads();
    hub->keepAccess();
  }

  base::Result<void> listen();
  void doAccept();
  void onAccept(error_code ec);
  void shutDown();
};

base::Result<void> Server::State::listen() {
  const ServerOptions& options = hub->options;
  error_code ec;
  const auto address = asio::ip::make_address(options.address, ec);
  if (ec)
    return base::Error{base::ErrorCode::kInvalidInput,
                       "'" + options.address +
                           "' is no IP address; use 127.0.0.1 for this machine alone or 0.0.0.0 for all its networks"};
  const Tcp::endpoint endpoint(address, options.port);
  acceptor.open(endpoint.protocol(), ec);
  if (!ec) acceptor.set_option(asio::socket_base::reuse_address(true), ec);
  if (!ec) acceptor.bind(endpoint, ec);
  if (!ec) acceptor.listen(asio::socket_base::max_listen_connections, ec);
  if (ec) return bindError(options.address, options.port, ec);
  hub->place = options.address + ":" + std::to_string(acceptor.local_endpoint(ec).port());
  return {};
}

void Server::State::doAccept() {
  acceptor.async_accept(incoming, [this](error_code ec) { onAccept(ec); });
}

void Server::State::onAccept(error_code ec) {
  if (hub->stopping || ec == asio::error::operation_aborted) return;
  if (ec) {
    spdlog::warn("accept: {}", ec.message());
    pause.expires_after(kAcceptPause);
    pause.async_wait([this](error_code cancelled) {
      if (!cancelled) doAccept();
    });
    return;
  }
  const std::size_t open = hub->connections.size();
  const bool turned_away = open >= hub->options.max_connections;
  if (turned_away) spdlog::warn("turn away: {} connections are open", open);
  Socket socket(std::move(incoming));  // which stands like new then
  if (open < std::size_t{hub->options.max_connections} + kTurnedAway)
    std::make_shared<HttpConnection>(hub, std::move(socket), turned_away)->start();
  doAccept();
}

void Server::State::shutDown() {
  if (hub->stopping) return;
  hub->stopping = true;
  spdlog::info("stopping: {} connections are open", hub->connections.size());
  error_code ignored;
  acceptor.close(ignored);
  pause.cancel();
  if (signals) signals->cancel(ignored);

  // A copy: leaving may end a connection at once.
  std::vector<std::shared_ptr<Connection>> leaving;
  for (Connection* connection : hub->connections) leaving.push_back(connection->shared_from_this());
  if (leaving.empty()) return;
  hub->goodbye.emplace(io, kGoodbye);
  hub->goodbye->async_wait([this](error_code cancelled) {
    if (!cancelled) io.stop();
  });
  for (const auto& connection : leaving) connection->leave();
}

base::Result<std::unique_ptr<Server>> Server::open(const std::vector<std::string>& scenes,
                                                   const ServerOptions& options) {
  std::unique_ptr<Server> server(new Server);
  server->state_ = std::make_unique<State>();
  State& state = *server->state_;
  state.hub = std::make_shared<Hub>(state.io, options);
  LUMIGRID_TRY(state.hub->open(scenes));
  LUMIGRID_TRY(state.hub->makeSites());
  LUMIGRID_TRY(state.listen());
  if (options.count_access)
    for (std::size_t i = 0; i < scenes.size(); ++i) state.hub->scenes[i]->countAccess(options, scenes[i]);
  state.hub->startFetchers();
  if (options.render_frames) state.hub->startRenderer();
  return server;
}

std::vector<std::string> Server::names() const {
  std::vector<std::string> names;
  for (const auto& hosted : state_->hub->scenes) names.push_back(hosted->name);
  return names;
}

Server::~Server() = default;

std::uint16_t Server::port() const {
  error_code ignored;
  return state_->acceptor.local_endpoint(ignored).port();
}

base::Result<void> Server::run(bool handle_signals) {
  State& state = *state_;
  if (handle_signals) {
    state.signals.emplace(state.io);
    error_code ec;
    state.signals->add(SIGINT, ec);
    if (!ec) state.signals->add(SIGTERM, ec);
    if (ec) return base::Error{base::ErrorCode::kIo, "cannot listen for SIGINT and SIGTERM: " + ec.message()};
    state.signals->async_wait([&state](error_code cancelled, int) {
      if (!cancelled) state.shutDown();
    });
  }
  state.doAccept();
  state.io.run();

  // Whoever did not close in time goes with `io`; nothing may wait for that.
  state.hub->goodbye.reset();
  state.hub->endThreads();
  state.hub->keepAccess();
  return {};
}

void Server::stop() {
  asio::post(state_->io, [this] { state_->shutDown(); });
}

}  // namespace server
