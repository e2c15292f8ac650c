#include "server/net/websocket_session.h"

#include <linux/sockios.h>
#include <netinet/tcp.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <algorithm>
#include <boost/beast/core/bind_handler.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket.hpp>
#include <list>
#include <optional>
#include <string>
#include <utility>

#include "base/format_text.h"
#include "server/log/log_text.h"
#include "server/net/connection.h"
#include "server/net/rate_limit.h"
#include "server/session/session_runner.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

namespace websocket = beast::websocket;

constexpr auto kHandshakeTimeout = std::chrono::seconds(10);  // for the upgrade, and for the peer's close frame
constexpr std::size_t kMaxCloseReason = 120;                  // bytes; RFC 6455, section 5.5.1, has room for 123
constexpr auto kPingTimeout = std::chrono::seconds(60);       // for the pong of a peer that is silent
constexpr std::uint8_t kViewType = 0x02;                      // docs/formats/protocol.md
constexpr double kMaxWatchSeconds = 10.0;                     // between two looks at a connection's deadlines
// Bytes. The first begins a message, and is what a connection keeps between two of them; the rest comes in pieces of
// the second at most. Beast has read ahead what came with the first.
constexpr std::size_t kFirstRead = 24;
constexpr std::size_t kNextRead = 65536;

SessionTotals totalsOf(const SessionCounts& counts) {
  return {.views = counts.views,
          .planned = counts.planned,
          .dropped = counts.replaced,
          .groups = counts.groups,
          .faces = counts.faces,
          .frames = counts.frames,
          .group_bytes = counts.group_bytes,
          .face_bytes = counts.face_bytes,
          .frame_bytes = counts.frame_bytes,
          .missing = counts.missing,
          .damaged = counts.corrupt};
}

class WebSocketSession final : public Connection {
 public:
  WebSocketSession(std::shared_ptr<Hub> hub, std::shared_ptr<HostedScene> hosted, const Visitor& visitor,
                   AnyStream&& stream);
  ~WebSocketSession() override;
  void start(const UpgradeRequest& upgrade);
  void closeForShutdown() override { close(websocket::close_code::going_away, "the server stops"); }
  void closeForOtherScene() override {
    close(websocket::close_code::service_restart, "this scene was replaced or is no longer served; connect again");
  }
  const HostedScene* scene() const override { return hosted_.get(); }

 private:
  void setSocketOptions();
  void setWebSocketOptions();
  void holdSegments(bool holds);
  void onAccept(error_code ec);
  void startRunner();
  void doRead();
  void readOn();
  void onRead(error_code ec, std::size_t bytes_read);
  double seconds() const { return std::chrono::duration<double>(SteadyClock::now() - start_time_).count(); }
  ConnectionState state();
  void onOutput(SessionOutput output);
  void takeOutput(SessionOutput output);
  void wakeAt(double at);
  void doWrite();
  void onWrite(error_code ec, std::size_t bytes_written);
  void requestFaces(FaceRequest request);
  void requestFrame(const FrameRequest& request);
  void drawWantedFrame();
  void watch();
  void checkDeadlines();
  bool isStalled(double now);
  void close(websocket::close_code code, const std::string& reason);
  void onClose(error_code ec);
  void fail(const std::string& reason);
  void endTimers();
  SteadyClock::time_point timeOf(double at) const {
    return start_time_ + std::chrono::duration_cast<SteadyClock::duration>(std::chrono::duration<double>(at));
  }

  const std::shared_ptr<HostedScene> hosted_;
  const std::uint64_t id_;
  const std::int64_t until_;  // Unix seconds
  SceneMetrics& metrics_;
  SessionReporter reporter_{metrics_};
  const SteadyClock::time_point start_time_ = SteadyClock::now();
  websocket::stream<AnyStream, false> socket_;
  std::shared_ptr<SessionRunner> runner_;
  std::string peer_;          // address:port
  std::string close_reason_;  // for the log; empty while the connection is open
  beast::flat_buffer incoming_;
  bool reading_ = false;
  // The first is being written. A list, here and in the session: an empty deque has 0.6 KB, which each quiet viewer
  // would cost four times.
  std::list<SharedMessage> outgoing_;
  std::uint64_t outgoing_bytes_ = 0;
  std::uint64_t tell_below_ = 0;  // outgoing bytes at which the session is told that there is room
  SteadyTimer wake_, watch_, read_pause_;
  RateLimit messages_;
  bool holds_segments_ = false;
  bool closing_ = false;
  bool refused_ = false;
  bool greeted_ = false;
  std::optional<FrameRequest> wanted_frame_;    // waits for the scene's documents
  std::optional<double> asked_at_;              // seconds: a view came, and no message was written since
  double last_heard_ = 0.0, last_taken_ = 0.0;  // seconds
  int queued_ = 0;                              // bytes in the kernel at the last look
  bool has_written_ = false;                    // since the last look
};

WebSocketSession::WebSocketSession(std::shared_ptr<Hub> hub, std::shared_ptr<HostedScene> hosted,
                                   const Visitor& visitor, AnyStream&& stream)
    : Connection(std::move(hub), visitor.address),
      hosted_(std::move(hosted)),
      id_(hub_->next_client++),
      until_(visitor.until),
      metrics_(hub_->metrics.scene(hosted_->scene->name)),
      socket_(std::move(stream)),
      wake_(socket_.get_executor()),
      watch_(socket_.get_executor()),
      read_pause_(socket_.get_executor()),
      messages_(hub_->options.messages_per_second) {
  error_code ignored;
  const auto endpoint = beast::get_lowest_layer(socket_).socket().remote_endpoint(ignored);
  ++hub_->viewers;
  hub_->metrics.viewers_open.add(1);
  hub_->metrics.viewers_accepted.add();
  peer_ = visitor.address + ":" + std::to_string(endpoint.port());
}

WebSocketSession::~WebSocketSession() {
  if (hub_->renderer) hub_->renderer->cancel(id_);
  hosted_->fetchers->forget(id_);
  if (runner_) runner_->end();
  --hub_->viewers;
  hub_->metrics.viewers_open.add(-1);
  const SessionCounts counts = runner_ ? runner_->counts() : SessionCounts();
  reporter_.report(totalsOf(counts));
  spdlog::info(
      "disconnect client={} peer={} seconds={:.1f} views={} groups={} faces={} frames={} bytes={} missing={} "
      "corrupt={} why={}",
      id_, peer_, seconds(), counts.views, counts.groups, counts.faces, counts.frames, counts.bytes, counts.missing,
      counts.corrupt, quoteText(close_reason_));
}

// ---- Opening

void WebSocketSession::start(const UpgradeRequest& upgrade) {
  spdlog::info("connect client={} peer={} viewers={}{}{}", id_, peer_, hub_->viewers,
               hosted_->name.empty() ? "" : " scene=", hosted_->name);
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

/// While it holds them, the kernel sends full segments alone, which may be of several messages: each that arrives wakes
/// the other side, or a proxy. What is held besides waits for the next message, or for 0.2 seconds; where the kernel
/// may hold less than a few of the loopback's segments, of 64 KB, that message would wait for room as long.
void WebSocketSession::holdSegments(bool holds) {
  constexpr std::uint64_t kFewSegments = 128 * 1024;
  if (hub_->options.max_unsent_bytes < kFewSegments) return;
  if (std::exchange(holds_segments_, holds) == holds) return;
  const int value = holds ? 1 : 0;
  ::setsockopt(beast::get_lowest_layer(socket_).socket().native_handle(), IPPROTO_TCP, TCP_CORK, &value, sizeof value);
}

void WebSocketSession::setWebSocketOptions() {
  websocket::stream_base::timeout timeout;
  timeout.handshake_timeout = kHandshakeTimeout;
  timeout.idle_timeout = kPingTimeout;
  timeout.keep_alive_pings = true;
  socket_.set_option(timeout);
  socket_.set_option(
      websocket::stream_base::decorator([](websocket::response_type& r) { r.set(http::field::server, "lumigrid"); }));
  socket_.read_message_max(protocol::kMaxClientMessage);
  socket_.binary(true);
  socket_.auto_fragment(false);
}

void WebSocketSession::onAccept(error_code ec) {
  if (ec) return fail("handshake: " + ec.message());
  startRunner();
  watch();
  doRead();
}

/// The answers of workers are posted to the io thread, where the session may be gone by then.
void WebSocketSession::startRunner() {
  const auto done = answerTo<SessionOutput>(
      this, [](WebSocketSession& self, SessionOutput output) { self.onOutput(std::move(output)); });
  hub_->workers.setAddress(id_, limitKey(address()));
  hub_->workers.setGroup(id_, hosted_->group);
  runner_ = std::make_shared<SessionRunner>(hosted_->scene->data, hosted_, hub_->workers, id_, done);
}

// ---- Messages of the viewer

/// Begins or goes on with a message. Reading a whole one would make room for 1.5 KB before anything has come, which
/// each quiet viewer would cost.
void WebSocketSession::doRead() {
  reading_ = true;
  const std::size_t most = incoming_.size() == 0 ? kFirstRead : std::min(kNextRead, socket_.read_size_hint(kNextRead));
  socket_.async_read_some(incoming_, most,
                          beast::bind_front_handler(&WebSocketSession::onRead, self<WebSocketSession>()));
}

/// Reads the next message, unless more of them wait already than a session takes at a time. A viewer that sends more
/// than it may is read more slowly.
void WebSocketSession::readOn() {
  // async_close() reads by itself what still comes before the peer's close frame.
  if (reading_ || closing_ || refused_ || runner_->isFull()) return;
  const double pause = messages_.secondsUntilNext(seconds());
  if (pause <= 0.0) {
    messages_.count(seconds());
    return doRead();
  }
  read_pause_.expires_at(timeOf(seconds() + pause));
  read_pause_.async_wait([self = self<WebSocketSession>()](error_code cancelled) {
    if (!cancelled) self->readOn();
  });
}

void WebSocketSession::onRead(error_code ec, std::size_t /*bytes_read*/) {
  reading_ = false;
  if (ec == websocket::error::closed) return fail("the viewer left");
  if (ec) return fail("read: " + ec.message());
  if (closing_) return;
  if (!socket_.is_message_done()) return doRead();
  if (!socket_.got_binary()) return close(websocket::close_code::unknown_data, "messages are binary");
  last_heard_ = seconds();
  const auto bytes = incoming_.cdata();
  const auto* first = static_cast<const std::uint8_t*>(bytes.data());
  metrics_.messages_received.add();
  if (bytes.size() > 0 && *first == kViewType && !asked_at_) asked_at_ = last_heard_;
  runner_->receive({first, first + bytes.size()}, state());
  incoming_.clear();
  if (incoming_.capacity() > kFirstRead) incoming_.shrink_to_fit();
  readOn();
}

// ---- Messages to the viewer

/// The kernel counts what it has; a message that is still being handed to it counts whole.
ConnectionState WebSocketSession::state() {
  const int handle = beast::get_lowest_layer(socket_).socket().native_handle();
  int queued = 0, unsent = 0;
  if (::ioctl(handle, SIOCOUTQ, &queued) != 0 || ::ioctl(handle, SIOCOUTQNSD, &unsent) != 0) queued = unsent = 0;
  tcp_info info{};
  socklen_t size = sizeof info;
  if (::getsockopt(handle, IPPROTO_TCP, TCP_INFO, &info, &size) != 0) info = {};
  return {{seconds(), outgoing_bytes_ + static_cast<std::uint64_t>(unsent), static_cast<std::uint64_t>(queued - unsent),
           1e-6 * info.tcpi_rtt},
          outgoing_bytes_};
}

void WebSocketSession::onOutput(SessionOutput output) {
  const bool was_idle = outgoing_.empty();
  takeOutput(std::move(output));
  if (was_idle) doWrite();
}

/// Does what a turn of the session says, but does not begin to write.
void WebSocketSession::takeOutput(SessionOutput output) {
  runner_->take(output);
  reporter_.report(totalsOf(runner_->counts()));
  if (output.plan_seconds) metrics_.plan_seconds.observe(*output.plan_seconds);
  if (output.client_name) {
    greeted_ = true;
    spdlog::info("hello client={} program={}", id_, quoteText(*output.client_name));
  }
  if (output.refusal) {
    refused_ = true;
    hub_->metrics.refused("protocol").add();
    close_reason_ = *output.refusal;
    spdlog::warn("refuse client={} peer={} why={}", id_, peer_, quoteText(close_reason_));
  }
  if (closing_) return;
  std::uint64_t added = 0;
  for (SharedMessage& message : output.messages) {
    added += message.size();
    outgoing_.push_back(std::move(message));
  }
  outgoing_bytes_ += added;
  tell_below_ = added / 2;
  for (FaceRequest& request : output.faces) requestFaces(std::move(request));
  if (output.frame) requestFrame(*output.frame);
  if (output.wake_at) wakeAt(*output.wake_at);
  readOn();
}

void WebSocketSession::wakeAt(double at) {
  wake_.expires_at(timeOf(at));
  wake_.async_wait([self = self<WebSocketSession>()](error_code cancelled) {
    if (cancelled) return;
    if (auto ready = self->runner_->wake(self->state())) self->onOutput(std::move(*ready));
  });
}

void WebSocketSession::doWrite() {
  if (closing_) return;
  if (outgoing_.size() > 1) holdSegments(true);  // until the last of them was written
  if (!outgoing_.empty())
    socket_.async_write(asio::buffer(outgoing_.front().bytes()),
                        beast::bind_front_handler(&WebSocketSession::onWrite, self<WebSocketSession>()));
  else if (refused_)
    close(websocket::close_code::policy_error, close_reason_);
}

void WebSocketSession::onWrite(error_code ec, std::size_t /*bytes_written*/) {
  if (ec) return fail("write: " + ec.message());
  has_written_ = true;
  if (asked_at_) metrics_.first_byte_seconds.observe(seconds() - *std::exchange(asked_at_, std::nullopt));
  const std::uint64_t before = outgoing_bytes_;
  outgoing_bytes_ -= outgoing_.front().size();
  outgoing_.pop_front();
  if (outgoing_.empty()) holdSegments(false);
  // Once in between, so that the next messages are made while these are written, and in the end.
  if (outgoing_.empty() || (before > tell_below_ && outgoing_bytes_ <= tell_below_))
    if (auto ready = runner_->tellRoom(state())) takeOutput(std::move(*ready));
  doWrite();
}

// ---- Answers of other threads: they are posted to the io thread, where the session may be gone by then

/// All faces of a request are fetched together, so that neighbours come with one range. A fetcher waits for the
/// network in place of the io thread.
void WebSocketSession::requestFaces(FaceRequest request) {
  const auto done = answerTo<Session::FaceValues>(this, [request](WebSocketSession& self, Session::FaceValues values) {
    self.runner_->facesFetched(request, std::move(values), self.state());
  });
  hosted_->fetchers->submit(id_, [done, images = hosted_->scene->images.get(), request = std::move(request)] {
    done(images->getMany(request));
  });
}

void WebSocketSession::requestFrame(const FrameRequest& request) {
  if (!hub_->renderer) return;
  const bool is_asked = std::exchange(wanted_frame_, request).has_value();
  if (is_asked) return;
  hosted_->whenFresh([weak = weak_from_this()] {
    if (const auto session = std::static_pointer_cast<WebSocketSession>(weak.lock())) session->drawWantedFrame();
  });
}

/// The newest request is drawn, as older ones would be replaced by it. The scene's light is as the documents have it.
void WebSocketSession::drawWantedFrame() {
  const FrameRequest request = *std::exchange(wanted_frame_, std::nullopt);
  if (closing_) return;
  const auto done =
      answerTo<protocol::EncodedFrame>(this, [request, start = seconds()](auto& self, protocol::EncodedFrame frame) {
        self.metrics_.frame_seconds.observe(self.seconds() - start);
        self.runner_->frameRendered(request, std::move(frame), self.state());
      });
  hub_->renderer->requestFrame(id_, limitKey(address()), hosted_->scene, request, done);
}

// ---- Closing

/// Looks at the deadlines when the next of them may be over. Looking seldom costs less than a timer for each message.
void WebSocketSession::watch() {
  const ServerOptions& options = hub_->options;
  double shortest = std::min({kMaxWatchSeconds, options.hello_seconds, options.stall_seconds, options.idle_seconds});
  if (until_ != kNoEnd) shortest = std::min(shortest, 2.0 * static_cast<double>(until_ - secondsNow()));
  watch_.expires_at(timeOf(seconds() + std::max(0.01, 0.5 * shortest)));
  watch_.async_wait([self = self<WebSocketSession>()](error_code cancelled) {
    if (!cancelled) self->checkDeadlines();
  });
}

/// The kernel takes some bytes even if the viewer reads none, and then no longer any, nor does it get rid of them.
bool WebSocketSession::isStalled(double now) {
  int queued = 0;
  if (::ioctl(beast::get_lowest_layer(socket_).socket().native_handle(), SIOCOUTQ, &queued) != 0) return false;
  const bool waits = !outgoing_.empty() || queued > 0;
  const bool moves = std::exchange(queued_, queued) != queued || std::exchange(has_written_, false);
  if (!waits || moves) last_taken_ = now;
  return now - last_taken_ > hub_->options.stall_seconds;
}

void WebSocketSession::checkDeadlines() {
  if (closing_) return;
  const ServerOptions& options = hub_->options;
  const double now = seconds();
  if (isStalled(now)) {
    hub_->metrics.refused("stall").add();
    return fail(base::formatText("the viewer took nothing for %.0f seconds", options.stall_seconds));
  }
  if (!greeted_ && !refused_ && now > options.hello_seconds) {
    hub_->metrics.refused("no hello").add();
    return close(websocket::close_code::policy_error, "no Hello came in time");
  }
  if (now - last_heard_ > options.idle_seconds)
    return close(websocket::close_code::going_away, "the viewer was silent for too long; it may connect again");
  if (until_ != kNoEnd && secondsNow() >= until_)
    return close(websocket::close_code::policy_error, "the link or token has expired; ask for a new one");
  watch();
}

void WebSocketSession::close(websocket::close_code code, const std::string& reason) {
  if (closing_) return;
  if (!runner_) return fail(reason);  // there was no handshake yet
  closing_ = true;
  if (close_reason_.empty()) close_reason_ = reason;
  holdSegments(false);
  endTimers();
  websocket::close_reason close_reason(code);
  close_reason.reason.assign(reason.data(), std::min(reason.size(), kMaxCloseReason));
  socket_.async_close(close_reason, beast::bind_front_handler(&WebSocketSession::onClose, self<WebSocketSession>()));
}

void WebSocketSession::onClose(error_code ec) {
  if (ec) fail("close: " + ec.message());
}

/// Ends the operations that are still pending, and so the session.
void WebSocketSession::fail(const std::string& reason) {
  if (close_reason_.empty()) close_reason_ = reason;
  closing_ = true;
  endTimers();
  beast::get_lowest_layer(socket_).close();
}

void WebSocketSession::endTimers() {
  wake_.cancel();
  watch_.cancel();
  read_pause_.cancel();
}

}  // namespace

void startWebSocketSession(std::shared_ptr<Hub> hub, std::shared_ptr<HostedScene> hosted, const Visitor& visitor,
                           AnyStream&& stream, const UpgradeRequest& upgrade) {
  std::make_shared<WebSocketSession>(std::move(hub), std::move(hosted), visitor, std::move(stream))->start(upgrade);
}

}  // namespace server
