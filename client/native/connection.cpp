#include "client/native/connection.h"

#include <algorithm>
#include <utility>

#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http/field.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>

#include "base/text.h"
#include "base/tls/any_stream.h"
#include "client/source/backoff.h"

namespace client {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace websocket = beast::websocket;
using asio::ip::tcp;
using Clock = LinkClock::Clock;

/// The time that an attempt to connect may take. A choice: a longer one is noticed by people.
constexpr std::chrono::seconds kConnectTimeout{10};
/// Silence after which the connection counts as lost; a ping is sent half-way. A choice: a ping every half minute also
/// keeps proxies from closing the connection, as nginx does after a minute unless told otherwise.
constexpr std::chrono::seconds kIdleTimeout{60};
/// Bytes that may wait for the render loop; above this, reading pauses, and TCP makes the server wait.
constexpr std::size_t kInboxLimit = 8 << 20;
constexpr unsigned kFirstRefusal = 400;  // of HTTP's statuses
/// Receive buffer with an emulated link: the system must not read seconds of it ahead.
constexpr int kLimitedReceiveBuffer = 64 << 10;

enum class EventKind { kConnected, kMessage, kDisconnected };

struct Event {
  EventKind kind = EventKind::kMessage;
  std::uint64_t epoch = 0;  ///< number of the connection
  base::Bytes bytes = {};
  std::string reason = {};
  Clock::time_point due = {};  ///< when the emulated link delivers it
};

struct OutgoingMessage {
  std::uint64_t epoch = 0;
  base::Bytes bytes;
};

}  // namespace

// ---- addresses ----

std::string ServerUrl::authority() const {
  return (host.find(':') == std::string::npos ? host : "[" + host + "]") + ":" + port;
}

base::Result<ServerUrl> parseServerUrl(const std::string& text) {
  const auto bad = [&](const std::string& why) {
    return base::Error{base::ErrorCode::kInvalidInput,
                       "'" + text + "': " + why + "; write it like ws://example.org:8080/"};
  };

  // Read the scheme.
  ServerUrl url;
  std::string rest = text;
  if (const std::size_t end = text.find("://"); end != std::string::npos) {
    const std::string scheme = text.substr(0, end);
    url.is_secure = scheme == "wss" || scheme == "https";
    if (!url.is_secure && scheme != "ws" && scheme != "http")
      return bad("'" + scheme + "' is not ws, wss, http or https");
    if (url.is_secure) url.port = "443";
    rest = text.substr(end + 3);
  } else {
    url.folder = text;
  }

  // Split off the path, then host and port.
  if (const std::size_t slash = rest.find('/'); slash != std::string::npos) {
    url.target = rest.substr(slash);
    rest.resize(slash);
  }
  std::size_t port_colon = rest.rfind(':');
  if (!rest.empty() && rest.front() == '[') {
    const std::size_t bracket = rest.find(']');
    if (bracket == std::string::npos) return bad("a bracket is not closed");
    url.host = rest.substr(1, bracket - 1);
    port_colon = bracket + 1 < rest.size() ? bracket + 1 : std::string::npos;
    if (port_colon != std::string::npos && rest[port_colon] != ':') return bad("something follows the bracket");
  } else {
    url.host = rest.substr(0, port_colon);
  }
  if (port_colon != std::string::npos) url.port = rest.substr(port_colon + 1);

  // Check each of them.
  if (url.host.empty()) return bad("it names no host");
  if (url.host.find_first_of(" \t\r\n@?#") != std::string::npos ||
      url.target.find_first_of(" \t\r\n") != std::string::npos)
    return bad("it holds a character that an address cannot have");
  const bool digits =
      !url.port.empty() && url.port.size() <= 5 && url.port.find_first_not_of("0123456789") == std::string::npos;
  if (!digits || std::stoi(url.port) < 1 || std::stoi(url.port) > 65535)
    return bad("its port '" + url.port + "' is not a number from 1 to 65535");
  return url;
}

// ---- the thread ----

struct Connection::Impl {
  Impl(const ServerUrl& to, const LinkLimit& limit, HostAccess given)
      : url(to), access(std::move(given)), resolver(io), retry_timer(io) {
    link_clock.setLimit(limit);
    asio::post(io, [this] { connect(); });
    thread = std::thread([this] { io.run(); });
  }
  ~Impl() {
    io.stop();
    thread.join();
  }

  /// One attempt or connection. Handlers of an older one find that it is no longer `link`, and stop.
  struct Link {
    explicit Link(asio::io_context& io) : socket(io), delay(io) {}
    std::uint64_t epoch = 0;
    websocket::stream<base::AnyStream<asio::any_io_executor>> socket;
    asio::steady_timer delay;
    websocket::response_type answer;  // to the handshake
    beast::flat_buffer buffer;
    base::Bytes writing;
    bool open = false;
    bool reading = false;
    bool busy_writing = false;
  };
  using LinkPointer = std::shared_ptr<Link>;

  // These run on the thread, in this order.
  void connect();
  void onResolved(const LinkPointer& on, const beast::error_code& error, tcp::resolver::results_type results);
  void onConnected(const LinkPointer& on, const beast::error_code& error);
  void startTls(const LinkPointer& on);
  void onTls(const LinkPointer& on, const beast::error_code& error);
  void startHandshake(const LinkPointer& on);
  void onHandshake(const LinkPointer& on, const beast::error_code& error);
  void read(const LinkPointer& on);
  void onRead(const LinkPointer& on, const beast::error_code& error);
  void write(const LinkPointer& on);
  void onWritten(const LinkPointer& on, const beast::error_code& error);
  void loseLink(LinkPointer on, const std::string& reason);

  // These lock the mutex, and are called by both threads.
  void push(Event event);
  bool inboxFull();
  std::vector<Event> takeDue();

  ServerUrl url;
  const HostAccess access;
  base::TlsContext tls;  // made for the first connection
  asio::io_context io;
  tcp::resolver resolver;
  asio::steady_timer retry_timer;
  LinkPointer link;
  std::uint64_t epochs = 0;
  Backoff backoff;

  std::mutex mutex;
  std::condition_variable arrived;
  LinkClock link_clock;
  std::deque<Event> inbox;
  std::size_t inbox_bytes = 0;
  std::deque<OutgoingMessage> outbox;

  // Only the session's thread uses this.
  std::uint64_t session_epoch = 0;  // the connection that the session uses; 0: none

  std::thread thread;
};

void Connection::Impl::connect() {
  link = std::make_shared<Link>(io);
  link->epoch = ++epochs;
  resolver.async_resolve(url.host, url.port, [this, on = link](const beast::error_code& error, auto results) {
    onResolved(on, error, std::move(results));
  });
}

void Connection::Impl::onResolved(const LinkPointer& on, const beast::error_code& error,
                                  tcp::resolver::results_type results) {
  if (error)
    return loseLink(on, "cannot find the host '" + url.host + "' (" + error.message() + "); check the address" +
                            (url.folder.empty() ? "" : "; nor is there a scene in a folder '" + url.folder + "'"));
  beast::tcp_stream& stream = beast::get_lowest_layer(on->socket);
  stream.expires_after(kConnectTimeout);
  stream.async_connect(results, [this, on](const beast::error_code& failed, const auto&) { onConnected(on, failed); });
}

void Connection::Impl::onConnected(const LinkPointer& on, const beast::error_code& error) {
  if (error)
    return loseLink(on,
                    "cannot reach " + url.authority() + " (" + error.message() + "); is lumigrid serve running there?");
  beast::tcp_stream& stream = beast::get_lowest_layer(on->socket);
  stream.expires_never();
  beast::error_code ignored;
  stream.socket().set_option(tcp::no_delay(true), ignored);
  {
    std::lock_guard lock(mutex);
    if (link_clock.limited())
      stream.socket().set_option(asio::socket_base::receive_buffer_size(kLimitedReceiveBuffer), ignored);
  }
  if (url.is_secure) return startTls(on);
  startHandshake(on);
}

void Connection::Impl::startTls(const LinkPointer& on) {
  if (!tls) {
    auto made = base::makeClientTls(access.ca_file);
    if (!made) return loseLink(on, made.error().message);
    tls = std::move(*made);
  }
  auto& stream = on->socket.next_layer();
  stream.startTlsAsClient(tls, url.host);
  stream.expires_after(kConnectTimeout);
  stream.async_handshake([this, on](const beast::error_code& failed) { onTls(on, failed); });
}

void Connection::Impl::onTls(const LinkPointer& on, const beast::error_code& error) {
  if (error) {
    const std::string problem = on->socket.next_layer().tlsProblem();
    backoff.slowDown();
    return loseLink(on, "no encrypted connection to " + url.authority() + " (" +
                            (problem.empty() ? error.message() : problem) +
                            "); check the address, or name the server's authority with --ca");
  }
  on->socket.next_layer().expires_never();
  startHandshake(on);
}

void Connection::Impl::startHandshake(const LinkPointer& on) {
  websocket::stream_base::timeout timeouts{};
  timeouts.handshake_timeout = kConnectTimeout;
  timeouts.idle_timeout = kIdleTimeout;
  timeouts.keep_alive_pings = true;
  on->socket.set_option(timeouts);
  on->socket.read_message_max(protocol::kMaxServerMessage);
  on->socket.binary(true);
  if (!access.token.empty())
    on->socket.set_option(websocket::stream_base::decorator([token = access.token](websocket::request_type& request) {
      request.set(beast::http::field::authorization, "Bearer " + token);
    }));
  on->socket.async_handshake(on->answer, url.authority(), url.target,
                             [this, on](const beast::error_code& failed) { onHandshake(on, failed); });
}

/// The server's own line, where it refuses in HTTP.
std::string refusalOf(const websocket::response_type& answer) {
  std::string line = answer.body().substr(0, answer.body().find('\n'));
  constexpr std::size_t kMaxLine = 300;
  if (!base::isPlainText(line) || line.size() > kMaxLine) line.clear();
  return "HTTP status " + std::to_string(answer.result_int()) + (line.empty() ? "" : ": " + line);
}

void Connection::Impl::onHandshake(const LinkPointer& on, const beast::error_code& error) {
  if (error == websocket::error::upgrade_declined && on->answer.result_int() >= kFirstRefusal) {
    backoff.slowDown();
    return loseLink(on, url.authority() + " refuses (" + refusalOf(on->answer) + ")");
  }
  if (error)
    return loseLink(on, url.authority() + " does not answer as a lumigrid server (" + error.message() +
                            "); check address and port");
  on->open = true;
  push({.kind = EventKind::kConnected, .epoch = on->epoch});
  read(on);
}

void Connection::Impl::read(const LinkPointer& on) {
  if (on != link || !on->open || on->reading || inboxFull()) return;
  on->reading = true;
  on->socket.async_read(on->buffer, [this, on](const beast::error_code& error, std::size_t) { onRead(on, error); });
}

void Connection::Impl::onRead(const LinkPointer& on, const beast::error_code& error) {
  if (error) return loseLink(on, "lost the connection to " + url.authority() + " (" + error.message() + ")");

  // A message proves that the server is there, so the next loss starts with short waits again.
  backoff.reset();
  Event event;
  event.epoch = on->epoch;
  const asio::const_buffer data = on->buffer.cdata();
  const auto* first = static_cast<const std::uint8_t*>(data.data());
  event.bytes.assign(first, first + data.size());
  on->buffer.consume(on->buffer.size());

  // The emulated link is busy with this message until `free`; only then the next read starts.
  Clock::time_point free;
  {
    std::lock_guard lock(mutex);
    free = link_clock.pass(event.bytes.size(), Clock::now());
  }
  push(std::move(event));
  on->delay.expires_at(free);
  on->delay.async_wait([this, on](const beast::error_code&) {
    on->reading = false;
    read(on);
  });
}

void Connection::Impl::write(const LinkPointer& on) {
  if (on != link || !on->open || on->busy_writing) return;
  {
    std::lock_guard lock(mutex);
    while (!outbox.empty() && outbox.front().epoch != on->epoch) outbox.pop_front();
    if (outbox.empty()) return;
    on->writing = std::move(outbox.front().bytes);
    outbox.pop_front();
  }
  on->busy_writing = true;
  on->socket.async_write(asio::buffer(on->writing),
                         [this, on](const beast::error_code& error, std::size_t) { onWritten(on, error); });
}

void Connection::Impl::onWritten(const LinkPointer& on, const beast::error_code& error) {
  on->busy_writing = false;
  if (error) return loseLink(on, "lost the connection to " + url.authority() + " (" + error.message() + ")");
  write(on);
}

/// Closes this link, reports it to the session, and connects again after the present wait. When read and write both
/// fail, the first failure counts.
void Connection::Impl::loseLink(LinkPointer on, const std::string& reason) {
  if (on != link) return;
  link.reset();
  on->open = false;
  beast::get_lowest_layer(on->socket).close();
  on->delay.cancel();

  push({.kind = EventKind::kDisconnected, .epoch = on->epoch, .reason = reason});

  retry_timer.expires_after(
      std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(backoff.nextPause())));
  retry_timer.async_wait([this](const beast::error_code& error) {
    if (!error) connect();
  });
}

// ---- between the threads ----

void Connection::Impl::push(Event event) {
  {
    std::lock_guard lock(mutex);
    event.due = link_clock.due();
    inbox_bytes += event.bytes.size();
    inbox.push_back(std::move(event));
  }
  arrived.notify_one();
}

bool Connection::Impl::inboxFull() {
  std::lock_guard lock(mutex);
  return inbox_bytes > kInboxLimit;
}

std::vector<Event> Connection::Impl::takeDue() {
  std::vector<Event> due;
  std::lock_guard lock(mutex);
  const Clock::time_point now = Clock::now();
  while (!inbox.empty() && inbox.front().due <= now) {
    inbox_bytes -= inbox.front().bytes.size();
    due.push_back(std::move(inbox.front()));
    inbox.pop_front();
  }
  return due;
}

// ---- the session's side ----

Connection::Connection(const ServerUrl& url, const LinkLimit& limit, const HostAccess& access)
    : impl_(std::make_unique<Impl>(url, limit, access)) {}
Connection::~Connection() = default;

bool Connection::pump(Session& session) {
  Impl& s = *impl_;

  // Hand over what has arrived.
  const std::vector<Event> events = s.takeDue();
  for (const Event& event : events) {
    if (event.kind == EventKind::kConnected) {
      s.session_epoch = event.epoch;
      session.connected();
    } else if (event.kind == EventKind::kDisconnected) {
      session.disconnected(event.reason);
      s.session_epoch = 0;
    } else if (event.epoch == s.session_epoch) {
      auto taken = session.receive(event.bytes);
      if (taken) continue;
      session.disconnected(taken.error().message);
      s.session_epoch = 0;
      asio::post(s.io, [&s, epoch = event.epoch, reason = taken.error().message] {
        if (!s.link || s.link->epoch != epoch) return;
        s.backoff.slowDown();
        s.loseLink(s.link, reason);
      });
    }
  }
  if (!events.empty())
    asio::post(s.io, [&s] {
      if (s.link) s.read(s.link);
    });

  // Send one message at a time: a view waits in the session, where a newer one replaces it.
  if (s.session_epoch == 0) return !events.empty();
  std::lock_guard lock(s.mutex);
  if (!s.outbox.empty()) return !events.empty();
  if (auto next = session.nextToSend()) {
    s.outbox.push_back({s.session_epoch, std::move(*next)});
    asio::post(s.io, [&s] {
      if (s.link) s.write(s.link);
    });
  }
  return !events.empty();
}

void Connection::waitForArrival(double seconds) {
  Impl& s = *impl_;
  std::unique_lock lock(s.mutex);
  waitForDelivery(lock, s.arrived, s.inbox, seconds);
}

}  // namespace client
