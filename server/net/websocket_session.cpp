#include "server/net/websocket_session.h"

#include <linux/sockios.h>
#include <netinet/tcp.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <algorithm>
#include <boost/beast/core/bind_handler.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket.hpp>
#include <optional>
#include <string>
#include <utility>

#include "server/net/connection.h"
#include "server/session/session.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

namespace websocket = beast::websocket;

constexpr auto kHandshakeTimeout = std::chrono::seconds(30);
constexpr std::size_t kMaxCloseReason = 120;  // bytes; RFC 6455, section 5.5.1, has room for 123

class WebSocketSession final : public Connection {
 public:
  WebSocketSession(std::shared_ptr<Hub> hub, const HostedScene& hosted, BeastStream&& stream);
  ~WebSocketSession() override;
  void start(const UpgradeRequest& upgrade);
  void closeForShutdown() override { close(websocket::close_code::going_away, "the server stops"); }

 private:
  void setSocketOptions();
  void setWebSocketOptions();
  void onAccept(error_code ec);
  void doRead();
  void onRead(error_code ec, std::size_t bytes_read);
  void receiveMessage();
  double seconds() const { return std::chrono::duration<double>(SteadyClock::now() - start_time_).count(); }
  LinkState linkState();
  void serve();
  void doWrite();
  void requestNextFrame();
  void wakeLater();
  void onWrite(error_code ec, std::size_t bytes_written);
  void requestFaces(FaceRequest request);
  void requestFrame(const FrameRequest& request);
  void close(websocket::close_code code, const std::string& reason);
  void onClose(error_code ec);
  void fail(const char* operation, error_code ec);

  const HostedScene& hosted_;
  const std::uint64_t id_;
  const SteadyClock::time_point start_time_ = SteadyClock::now();
  websocket::stream<BeastStream, false> socket_;
  Session session_;
  std::string peer_;          // address:port
  std::string close_reason_;  // for the log; empty while the connection is open
  beast::flat_buffer incoming_;
  std::optional<base::Bytes> outgoing_;
  SteadyTimer wake_;
  bool writing_ = false;
  bool closing_ = false;
  bool refused_ = false;
  bool hello_logged_ = false;
};

WebSocketSession::WebSocketSession(std::shared_ptr<Hub> hub, const HostedScene& hosted, BeastStream&& stream)
    : Connection(std::move(hub)),
      hosted_(hosted),
      id_(hub_->next_client++),
      socket_(std::move(stream)),
      session_(hosted.scene->data),
      wake_(socket_.get_executor()) {
  error_code ignored;
  const auto endpoint = beast::get_lowest_layer(socket_).socket().remote_endpoint(ignored);
  ++hub_->viewers;
  peer_ = endpoint.address().to_string() + ":" + std::to_string(endpoint.port());
}

WebSocketSession::~WebSocketSession() {
  if (hub_->renderer) hub_->renderer->cancel(id_);
  --hub_->viewers;
  const SessionCounts& counts = session_.counts();
  spdlog::info(
      "disconnect client={} peer={} seconds={:.1f} views={} groups={} faces={} frames={} bytes={} missing={} "
      "corrupt={} why=\"{}\"",
      id_, peer_, seconds(), counts.views, counts.groups, counts.faces, counts.frames, counts.bytes, counts.missing,
      counts.corrupt, close_reason_);
}

// ---- Opening

void WebSocketSession::start(const UpgradeRequest& upgrade) {
  spdlog::info("connect client={} peer={} viewers={}{}{}", id_, peer_, hub_->viewers,
               hosted_.name.empty() ? "" : " scene=", hosted_.name);
  setSocketOptions();
  setWebSocketOptions();
  socket_.async_accept(upgrade, beast::bind_front_handler(&WebSocketSession::onAccept, self<WebSocketSession>()));
}

/// Small messages are sent at once, and few bytes wait in the kernel: what waits there can no longer be replaced by
/// data for a newer view.
void WebSocketSession::setSocketOptions() {
  auto& socket = beast::get_lowest_layer(socket_).socket();
  error_code ignored;
  socket.set_option(Tcp::no_delay(true), ignored);
  const int max_unsent = static_cast<int>(std::clamp<std::uint64_t>(hub_->options.max_unsent_bytes, 4096, 1 << 30));
  ::setsockopt(socket.native_handle(), IPPROTO_TCP, TCP_NOTSENT_LOWAT, &max_unsent, sizeof max_unsent);
}

void WebSocketSession::setWebSocketOptions() {
  websocket::stream_base::timeout timeout;
  timeout.handshake_timeout = kHandshakeTimeout;
  timeout.idle_timeout =
      std::chrono::duration_cast<SteadyClock::duration>(std::chrono::duration<double>(hub_->options.idle_seconds));
  timeout.keep_alive_pings = true;
  socket_.set_option(timeout);
  socket_.set_option(
      websocket::stream_base::decorator([](websocket::response_type& r) { r.set(http::field::server, "lumigrid"); }));
  socket_.read_message_max(protocol::kMaxClientMessage);
  socket_.binary(true);
  socket_.auto_fragment(false);
}

void WebSocketSession::onAccept(error_code ec) {
  if (ec) return fail("handshake", ec);
  doRead();
}

// ---- Messages of the viewer

void WebSocketSession::doRead() {
  socket_.async_read(incoming_, beast::bind_front_handler(&WebSocketSession::onRead, self<WebSocketSession>()));
}

void WebSocketSession::onRead(error_code ec, std::size_t /*bytes_read*/) {
  if (ec) return fail("read", ec);
  if (closing_ || refused_) {
    // Only the peer's close frame still matters; its other messages are dropped.
    incoming_.clear();
    return doRead();
  }
  if (!socket_.got_binary()) return close(websocket::close_code::unknown_data, "messages are binary");
  session_.setLink(linkState());
  receiveMessage();
  serve();
  doRead();
}

void WebSocketSession::receiveMessage() {
  const auto bytes = incoming_.cdata();
  const auto received = session_.receive({static_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
  if (!received) {
    refused_ = true;
    close_reason_ = received.error().message;
    spdlog::warn("refuse client={} peer={} why=\"{}\"", id_, peer_, close_reason_);
  } else if (!hello_logged_ && !session_.clientName().empty()) {
    hello_logged_ = true;
    spdlog::info("hello client={} program=\"{}\"", id_, session_.clientName());
  }
  incoming_.clear();
}

// ---- Messages to the viewer

/// The kernel counts what it has; a message that is still being handed to it counts whole.
LinkState WebSocketSession::linkState() {
  const int handle = beast::get_lowest_layer(socket_).socket().native_handle();
  int queued = 0, unsent = 0;
  if (::ioctl(handle, SIOCOUTQ, &queued) != 0 || ::ioctl(handle, SIOCOUTQNSD, &unsent) != 0) queued = unsent = 0;
  tcp_info info{};
  socklen_t size = sizeof info;
  if (::getsockopt(handle, IPPROTO_TCP, TCP_INFO, &info, &size) != 0) info = {};
  const std::uint64_t writing = writing_ ? outgoing_->size() : 0;
  return {seconds(), writing + static_cast<std::uint64_t>(unsent), static_cast<std::uint64_t>(queued - unsent),
          1e-6 * info.tcpi_rtt};
}

/// Sends and requests all that can be now; called whenever anything happened.
void WebSocketSession::serve() {
  if (closing_) return;
  session_.setLink(linkState());
  requestNextFrame();
  if (!writing_) doWrite();
  if (closing_) return;
  requestNextFrame();
  wakeLater();
}

void WebSocketSession::doWrite() {
  outgoing_ = session_.nextMessage();
  while (auto request = session_.nextFaceRequest()) requestFaces(std::move(*request));
  if (outgoing_) {
    writing_ = true;
    socket_.async_write(asio::buffer(*outgoing_),
                        beast::bind_front_handler(&WebSocketSession::onWrite, self<WebSocketSession>()));
  } else if (session_.finished()) {
    close(websocket::close_code::policy_error, close_reason_);
  }
}

void WebSocketSession::requestNextFrame() {
  if (const auto request = session_.nextFrameRequest()) requestFrame(*request);
}

void WebSocketSession::wakeLater() {
  const auto at = session_.wakeAt();
  if (!at) return;
  wake_.expires_at(start_time_ + std::chrono::duration_cast<SteadyClock::duration>(std::chrono::duration<double>(*at)));
  wake_.async_wait([self = self<WebSocketSession>()](error_code ec) {
    if (!ec) self->serve();
  });
}

void WebSocketSession::onWrite(error_code ec, std::size_t /*bytes_written*/) {
  writing_ = false;
  if (ec) return fail("write", ec);
  serve();
}

// ---- Answers of other threads: they are posted to the io thread, where the session may be gone by then

/// All faces of a request are fetched together, so that neighbours come with one range. A fetcher waits for the
/// network in place of the io thread.
void WebSocketSession::requestFaces(FaceRequest request) {
  const auto done = answerTo<Session::FaceValues>(this, [request](WebSocketSession& self, Session::FaceValues values) {
    self.session_.facesFetched(request, std::move(values));
    self.serve();
  });
  hub_->fetchers->submit([done, hub = hub_.get(), images = hosted_.scene->images.get(), request = std::move(request)] {
    if (!hub->stopping) done(images->getMany(request));
  });
}

void WebSocketSession::requestFrame(const FrameRequest& request) {
  if (!hub_->renderer) return;
  hosted_.site->readAppearance();
  const auto done = answerTo<base::Bytes>(this, [request](WebSocketSession& self, base::Bytes value) {
    self.session_.setLink(self.linkState());
    self.session_.frameRendered(request, std::move(value));
    self.serve();
  });
  hub_->renderer->requestFrame(id_, hosted_.number, request, done);
}

// ---- Closing

void WebSocketSession::close(websocket::close_code code, const std::string& reason) {
  if (closing_) return;
  closing_ = true;
  if (close_reason_.empty()) close_reason_ = reason;
  websocket::close_reason close_reason(code);
  close_reason.reason.assign(reason.data(), std::min(reason.size(), kMaxCloseReason));
  socket_.async_close(close_reason, beast::bind_front_handler(&WebSocketSession::onClose, self<WebSocketSession>()));
}

void WebSocketSession::onClose(error_code ec) {
  if (ec) fail("close", ec);
}

void WebSocketSession::fail(const char* operation, error_code ec) {
  if (close_reason_.empty())
    close_reason_ = ec == websocket::error::closed ? "the viewer left" : std::string(operation) + ": " + ec.message();
  closing_ = true;
  // Ends the operations that are still pending, and so the session.
  beast::get_lowest_layer(socket_).close();
}

}  // namespace

void startWebSocketSession(std::shared_ptr<Hub> hub, const HostedScene& hosted, BeastStream&& stream,
                           const UpgradeRequest& upgrade) {
  std::make_shared<WebSocketSession>(std::move(hub), hosted, std::move(stream))->start(upgrade);
}

}  // namespace server
