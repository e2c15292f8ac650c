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
#include <chrono>
#include <csignal>
#include <filesystem>
#include <mutex>
#include <optional>
#include <set>
#include <string_view>

#include "server/net/access_log.h"
#include "server/net/byte_range.h"
#include "server/net/frame_renderer.h"
#include "server/net/open_scene.h"
#include "server/net/server.h"
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

constexpr auto kHttpIdle = std::chrono::seconds(30);
constexpr auto kHandshake = std::chrono::seconds(30);
constexpr auto kGoodbye = std::chrono::seconds(2);  // what viewers get to close when the server stops
constexpr auto kAcceptPause =
    std::chrono::milliseconds(100);  // after an accept that failed, e.g. for want of descriptors
constexpr std::uint64_t kSlowestBytesPerSecond = 16 * 1024;  // a slower HTTP download is cut
constexpr std::uint32_t kHeaderLimit = 8 * 1024;
constexpr std::uint32_t kTurnedAway = 64;  // connections over the limit that still get a 503

class Connection;

/// What all connections share. One thread (the io thread) uses it, but for the renderer, which has its own lock.
struct Hub {
  asio::io_context& io;
  ServerOptions options;
  std::unique_ptr<OpenScene> scene;
  std::unique_ptr<FrameRenderer> renderer;  // null: no exact frames
  std::unique_ptr<AccessLog> access;        // null: nothing is counted
  std::string place;                        // address:port
  std::set<Connection*> connections;
  std::uint64_t next_client = 1;
  std::size_t viewers = 0;
  bool stopping = false;
  std::optional<asio::basic_waitable_timer<Clock, asio::wait_traits<Clock>, Executor>> goodbye;

  void countAccess(const std::string& scene_directory);
  /// Writes what was counted; from here on nothing is.
  void keepAccess() {
    scene->data.access = nullptr;
    access.reset();
  }
};

void Hub::countAccess(const std::string& scene_directory) {
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
  Viewer(std::shared_ptr<Hub> hub, Stream&& stream)
      : Connection(std::move(hub)), id_(hub_->next_client++), socket_(std::move(stream)), session_(hub_->scene->data) {
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
    spdlog::info("connect client={} peer={} viewers={}", id_, peer_, hub_->viewers);
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

  /// The renderer answers on its own thread; the answer comes back to this one, where the viewer may be gone.
  void askForFrame(const FrameRequest& request) {
    if (!hub_->renderer) return;
    std::weak_ptr<Connection> weak = weak_from_this();
    hub_->renderer->submit(id_, request, [weak, request, &io = hub_->io](base::Bytes value) {
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
// Plain HTTP: small answers and byte ranges; or the upgrade to a viewer.

struct Reply {
  http::status status = http::status::ok;
  const char* type = "text/plain; charset=utf-8";
  std::string text;      // the body, unless `bytes` is set
  base::ByteView bytes;  // a body that lives with the scene
  std::optional<ByteRange> range;
  std::uint64_t whole = 0;  // size of what the range is part of
};

Reply textReply(http::status status, std::string text) {
  return {.status = status, .text = std::move(text), .bytes = {}, .range = {}};
}

std::string escapeHtml(std::string_view text) {
  std::string out;
  for (char c : text) {
    if (c == '<' || c == '>' || c == '&' || c == '"') {
      out += "&#" + std::to_string(static_cast<int>(c)) + ";";
    } else {
      out += c;
    }
  }
  return out;
}

/// `host`: as the visitor typed it, so that the command works from where they are.
std::string homePage(const Hub& hub, const std::string& host) {
  const std::string name = escapeHtml(hub.scene->data.welcome.scene_name);
  return "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>" + name + " - Lumigrid</title>\n<h1>" +
         name + "</h1>\n<p>" + std::to_string(hub.scene->data.welcome.source_triangles) +
         " triangles. Look at it with</p>\n<pre>lumigrid-view ws://" + host + "/</pre>\n</html>\n";
}

class HttpConnection final : public Connection {
 public:
  HttpConnection(std::shared_ptr<Hub> hub, Socket&& socket, bool turned_away)
      : Connection(std::move(hub)), stream_(std::move(socket)), turned_away_(turned_away) {}

  void start() { doRead(); }
  void leave() override { stream_.close(); }

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
    const auto& request = parser_->get();
    const std::string_view path = pathOf(request);
    const bool upgrade = websocket::is_upgrade(request) && (path == "/" || path == "/ws");
    if (!upgrade || turned_away_) return doWrite(answer(request, path));

    stream_.expires_never();  // the WebSocket has its own timeouts
    auto viewer = std::make_shared<Viewer>(hub_, std::move(stream_));
    viewer->start(request);
  }

  static std::string_view pathOf(const http::request<http::empty_body>& request) {
    const std::string_view target(request.target().data(), request.target().size());
    return target.substr(0, target.find('?'));
  }

  Reply answer(const http::request<http::empty_body>& request, std::string_view path) {
    using http::status;
    if (turned_away_)
      return textReply(status::service_unavailable, "this server has as many viewers as it may; try again later\n");
    if (request.method() != http::verb::get && request.method() != http::verb::head)
      return textReply(status::method_not_allowed, "only GET and HEAD\n");
    if (path == "/healthz") return textReply(status::ok, "ok");
    if (path == "/")
      return {.type = "text/html; charset=utf-8", .text = homePage(*hub_, hostOf(request)), .bytes = {}, .range = {}};
    if (path == "/scene.json")
      return {.type = "application/json", .text = {}, .bytes = hub_->scene->scene_json, .range = {}};
    if (path == "/patch.lgp" || path.substr(1) == base::partFile(hub_->scene->scene, "patch", ".lgp"))
      return part(request, hub_->scene->patch_bytes.bytes());
    return textReply(status::not_found,
                     "not here; there are /, /scene.json, /patch.lgp, /healthz and the WebSocket at /\n");
  }

  static Reply part(const http::request<http::empty_body>& request, base::ByteView whole) {
    const auto header = request[http::field::range];
    const ByteRange range = parseByteRange({header.data(), header.size()}, whole.size());
    Reply reply{.type = "application/octet-stream", .text = {}, .bytes = whole, .range = range, .whole = whole.size()};
    if (range.kind == ByteRange::Kind::kPart) {
      reply.status = http::status::partial_content;
      reply.bytes = whole.subspan(range.first, range.length);
    } else if (range.kind == ByteRange::Kind::kUnsatisfiable) {
      reply.status = http::status::range_not_satisfiable;
      reply.bytes = {};
    }
    return reply;
  }

  /// The Host header, or our own place when it is none that could be shown.
  std::string hostOf(const http::request<http::empty_body>& request) const {
    const auto host = request[http::field::host];
    const std::string text(host.data(), host.size());
    const bool plain = !text.empty() && text.size() < 256 &&
                       text.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-:[]") ==
                           std::string::npos;
    return plain ? text : hub_->place;
  }

  void doWrite(Reply reply) {
    const auto& request = parser_->get();
    text_ = std::move(reply.text);
    if (reply.bytes.empty()) reply.bytes = {reinterpret_cast<const std::uint8_t*>(text_.data()), text_.size()};
    response_.emplace();
    response_->result(reply.status);
    response_->version(request.version());
    response_->keep_alive(request.keep_alive() && !turned_away_ && !hub_->stopping);
    response_->set(http::field::server, "lumigrid");
    response_->set(http::field::content_type, reply.type);
    response_->set(http::field::cache_control, "no-cache");
    response_->set("X-Content-Type-Options", "nosniff");
    // Any page may read what anybody may fetch: scenes on a server without tokens are public.
    response_->set(http::field::access_control_allow_origin, "*");
    response_->set(http::field::access_control_expose_headers, "Accept-Ranges, Content-Length, Content-Range");
    if (reply.range) {
      response_->set(http::field::accept_ranges, "bytes");
      if (reply.range->kind != ByteRange::Kind::kWhole)
        response_->set(http::field::content_range, contentRange(*reply.range, reply.whole));
    }
    response_->body() = {reply.bytes.data(), reply.bytes.size()};
    response_->content_length(reply.bytes.size());

    stream_.expires_after(kHttpIdle + std::chrono::seconds(reply.bytes.size() / kSlowestBytesPerSecond));
    serializer_.emplace(*response_);
    auto handler = beast::bind_front_handler(&HttpConnection::onWrite, self<HttpConnection>());
    if (request.method() == http::verb::head)
      return http::async_write_header(stream_, *serializer_, std::move(handler));
    http::async_write(stream_, *serializer_, std::move(handler));
  }

  void onWrite(error_code ec, std::size_t) {
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
  beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::empty_body>> parser_;
  std::string text_;
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
  asio::basic_waitable_timer<Clock, asio::wait_traits<Clock>, Executor> pause{io};
  std::optional<asio::basic_signal_set<Executor>> signals;

  ~State() {
    if (!hub) return;
    hub->renderer.reset();  // its thread posts to `io`, which goes last
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

namespace {

constexpr std::size_t kMostToldErrors = 100;

// What of published images cannot be read, each thing once: a missing pack holds hundreds of faces, and viewers ask for
// them again and again.
void logImageErrors(OpenScene& scene) {
  if (scene.packs == nullptr) return;
  struct Told {
    std::mutex mutex;
    std::set<std::string> messages;
  };
  scene.packs->onError([told = std::make_shared<Told>()](const base::Error& error) {
    const std::lock_guard guard(told->mutex);
    if (told->messages.size() < kMostToldErrors && told->messages.insert(error.message).second)
      spdlog::warn("image: {}", error.message);
  });
}

}  // namespace

base::Result<std::unique_ptr<Server>> Server::open(const std::string& scene_directory, const ServerOptions& options) {
  RemoteOptions remote = options.remote;
  remote.warn = [](const std::string& what) { spdlog::warn("cache: {}", what); };
  auto scene = openScene(scene_directory, remote);
  if (!scene) return scene.error();
  logImageErrors(**scene);

  std::unique_ptr<Server> server(new Server);
  server->state_ = std::make_unique<State>();
  State& state = *server->state_;
  state.hub =
      std::shared_ptr<Hub>(new Hub{state.io, options, std::move(*scene), nullptr, nullptr, {}, {}, 1, 0, false, {}});
  LUMIGRID_TRY(state.listen());
  if (options.count_access) state.hub->countAccess(scene_directory);

  if (options.render_frames) {
    auto renderer = FrameRenderer::start(*state.hub->scene);
    if (renderer) {
      state.hub->renderer = std::move(*renderer);
      state.hub->scene->data.welcome.can_render_frames = true;
    } else {
      spdlog::warn("no exact frames: {}", renderer.error().message);
    }
  }
  return server;
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
  state.hub->renderer.reset();
  state.hub->keepAccess();
  return {};
}

void Server::stop() {
  asio::post(state_->io, [this] { state_->shutDown(); });
}

}  // namespace server
