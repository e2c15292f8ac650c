#include "server/net/http_session.h"

#include <boost/asio/write.hpp>
#include <boost/beast/core/bind_handler.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket/rfc6455.hpp>

#include <algorithm>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>

#include "server/net/connection.h"
#include "server/net/http_text.h"
#include "server/net/pick.h"
#include "server/net/picture.h"
#include "server/net/websocket_session.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

// Choices, but for Beast's: shorter times and smaller numbers cut slow clients off, larger ones let more of them hold
// connections and memory.
constexpr auto kTurnedAwayTimeout = std::chrono::seconds(2);  // for what a refusal needs: handshake, request, its rest
constexpr auto kHandshakeTimeout = std::chrono::seconds(10);  // of TLS
constexpr auto kIdleTimeout = std::chrono::seconds(30);       // for the next request on an open connection
constexpr auto kAnswerTimeout = std::chrono::minutes(10);     // for a picture, a picked point or a range of a file
constexpr std::uint32_t kMaxHeaderBytes = 8 * 1024;           // Beast's default for requests
constexpr std::size_t kMaxDiscarded = 256 * 1024;             // bytes behind a request that was refused
constexpr std::uint64_t kMaxRange = std::uint64_t{1} << 20;   // bytes of a file that a connection holds
constexpr std::size_t kMaxPiece = std::size_t{1} << 20;       // bytes of a body that have a time limit of their own

class HttpSession final : public Connection {
 public:
  HttpSession(std::shared_ptr<Hub> hub, TcpSocket&& socket, const std::string& address, bool turned_away)
      : Connection(std::move(hub), address),
        stream_(std::move(socket)),
        peer_(parseIpAddress(address).value_or(IpAddress())),
        deadline_(stream_.get_executor()),
        turned_away_(turned_away ? limitKey(address) : std::string()),
        fetch_client_(hub_->next_client++) {
    if (isTurnedAway()) ++hub_->turned_away_of[turned_away_];
    hub_->metrics.http_open.add(1);
    hub_->metrics.http_accepted.add();
  }
  ~HttpSession() override {
    leaveScene();
    if (const auto it = hub_->turned_away_of.find(turned_away_); isTurnedAway() && --it->second == 0)
      hub_->turned_away_of.erase(it);
    hub_->metrics.http_open.add(-1);
  }
  void start();
  void closeForShutdown() override {
    if (!is_upgraded_) close();
  }
  const HostedScene* scene() const override { return nullptr; }  // an answer that was begun is finished
  /// Who has just come may be about to ask for the server's health.
  void closeForDrain() override {
    if (!reading_) return;
    if (requests_ > 0) return closeForShutdown();
    allowTimeToRead(kTurnedAwayTimeout);
  }

 private:
  void onHandshake(error_code ec);
  void answerPlainHttp();
  void doRead();
  void allowTimeToRead(SteadyClock::duration time);
  void onRead(error_code ec, std::size_t bytes_read);
  void onUnreadable(error_code ec);
  void readHead();
  void answer(HttpRequest request);
  void answerAfresh(const HttpRequest& request);
  bool refuse();
  void onFresh(const HttpRequest& request);
  void answerFromScene(const HttpRequest& request);
  void upgradeToWebSocket();

  // Answers of other threads. Each has an id; answers that nobody waits for any more are dropped.
  void requestPicture(const HttpRequest& request);
  void onPicture(const char* type, base::Result<base::Bytes> bytes);
  void requestPick(const HttpRequest& request);
  void onPick(base::Result<std::string> json);
  /// Calls accept(session, answer) if the answer of this id is still waited for.
  template <class Answer, class Accept>
  auto whenAwaited(std::uint64_t id, Accept accept) {
    return answerTo<Answer>(this, [id, accept](HttpSession& session, Answer answer) {
      if (session.awaited_ != id) return;
      session.stopWaiting();
      accept(session, std::move(answer));
    });
  }
  void waitForAnswer(std::uint64_t id);
  void onAnswerTimeout(std::uint64_t id);
  void onReadable(std::uint64_t id);
  void stopWaiting();
  void leaveScene();

  // Bodies of the scene's files. A range is read on another thread, then written; status and header fields are written
  // after the first one was read, so that they can tell of an error.
  void readRange();
  void onRange(base::Result<base::Bytes> bytes);

  // A large body is written piece by piece after its header, so that a peer that takes nothing is soon noticed.
  void doWrite(HttpReply reply);
  void onHeader(error_code ec, std::size_t bytes_written);
  void writePiece();
  void onPiece(error_code ec, std::size_t bytes_written);
  void setFields(const UpgradeRequest& request);
  void allowTimeToWrite(std::size_t bytes);
  void onWrite(error_code ec, std::size_t bytes_written);
  void shutDownSending();
  void closeBehindTheRest();
  void discard();
  void close();
  bool isTurnedAway() const { return !turned_away_.empty(); }

  using Body = http::span_body<const std::uint8_t>;
  AnyStream stream_;
  const IpAddress peer_;
  IpAddress client_;          // the peer, or who asks by it where it is a trusted proxy
  SteadyTimer deadline_;      // of reading
  bool is_upgraded_ = false;  // the stream has gone to a WebSocket session; handlers still hold this one for a moment
  bool reading_ = false;      // waits for a request or its rest
  bool is_late_ = false;
  bool keep_alive_ = true;
  std::uint64_t requests_ = 0;
  const std::string turned_away_;  // limitKey() of the peer's address, if it gets nothing but a refusal; else empty
  std::shared_ptr<HostedScene> hosted_;  // the scene that the current request addresses
  const std::uint64_t fetch_client_;     // the session's number among those whom the scene's fetchers work for
  beast::flat_buffer buffer_;
  std::size_t discarded_ = 0;
  std::optional<http::request_parser<http::empty_body>> parser_;
  std::string cookies_;                   // of the current request, joined
  RequestHead head_;                      // points into parser_ and cookies_
  std::optional<std::uint64_t> awaited_;  // id of the answer
  std::optional<SteadyTimer> answer_timer_;
  std::optional<UnsentPicture> picture_;  // the body of the current answer
  bool header_written_ = false;           // the header of a reply whose body follows piece by piece
  HttpReply reply_;
  base::ByteView unwritten_;  // what is left of the body, or of its range that was read
  std::optional<http::response<Body>> response_;
  std::optional<http::response_serializer<Body>> serializer_;
};

/// A page's links are relative to its folder, so "/tower" leads to "/tower/".
HttpReply redirectToFolder(const std::string& name) {
  return textReply(301, "see /" + name + "/\n", {{"Location", "/" + name + "/"}});
}

/// The answer to HEAD where the length of the body is not known without making it.
HttpReply headReply(const char* type) {
  return {.type = type, .cache = "no-store", .has_length = false};
}

/// A disk may be mended and a network come back; what is wrong at its origin stays so.
HttpReply fileErrorReply(const base::Error& error) {
  const std::string text = "this file cannot be read where the scene lies; the server's log says why\n";
  const bool may_pass = error.code == base::ErrorCode::kNetwork || error.code == base::ErrorCode::kIo;
  return may_pass ? tryLater(kRetrySeconds, text) : textReply(502, text);
}

/// Bytes of the scene that are damaged or cannot be read are no fault of the renderer's.
HttpReply renderErrorReply(const base::Error& error) {
  const std::string text = "the picture could not be rendered; the server's log says why\n";
  const bool is_data = error.code == base::ErrorCode::kInvalidInput || error.code == base::ErrorCode::kIo;
  return is_data ? tryLater(kRetrySeconds, text) : textReply(500, text);
}

SteadyClock::duration durationOf(double seconds) {
  return std::chrono::duration_cast<SteadyClock::duration>(std::chrono::duration<double>(seconds));
}

HttpRequest viewOf(const UpgradeRequest& request) {
  const auto view = [](beast::string_view text) { return std::string_view(text.data(), text.size()); };
  return {view(request.method_string()),
          view(request.target()),
          view(request[http::field::host]),
          view(request[http::field::range]),
          view(request[http::field::if_range]),
          view(request[http::field::if_none_match]),
          view(request[http::field::accept_encoding])};
}

// ---- TLS

void HttpSession::start() {
  if (!hub_->security->tls) return doRead();
  stream_.startTlsAsServer(hub_->security->tls);
  stream_.expires_after(isTurnedAway() ? kTurnedAwayTimeout : kHandshakeTimeout);
  stream_.async_handshake(beast::bind_front_handler(&HttpSession::onHandshake, self<HttpSession>()));
}

void HttpSession::onHandshake(error_code ec) {
  if (!ec) return doRead();
  if (stream_.metPlainHttp()) answerPlainHttp();
}

/// Tells a visitor who wrote http:// what to write.
void HttpSession::answerPlainHttp() {
  static const std::string answer =
      closingAnswer("400 Bad Request", "this port speaks TLS; begin the address with https://\n");
  stream_.expires_never();
  auto& tcp = stream_.next_layer();
  tcp.expires_after(kHandshakeTimeout);
  // Bytes left unread would have the system reset the connection, and the answer might be lost.
  error_code ignored;
  tcp.socket().non_blocking(true, ignored);
  buffer_.commit(tcp.socket().read_some(buffer_.prepare(kMaxHeaderBytes), ignored));
  asio::async_write(tcp, asio::buffer(answer), [self = self<HttpSession>()](error_code, std::size_t) {
    error_code also_ignored;
    self->stream_.socket().shutdown(Tcp::socket::shutdown_send, also_ignored);
  });
}

// ---- Reading requests

void HttpSession::doRead() {
  head_ = {};
  leaveScene();
  parser_.emplace();
  parser_->header_limit(kMaxHeaderBytes);
  parser_->body_limit(0);
  reading_ = true;
  allowTimeToRead(isTurnedAway() || hub_->draining ? kTurnedAwayTimeout
                  : requests_ == 0                 ? durationOf(hub_->options.head_seconds)
                                                   : kIdleTimeout);
  http::async_read(stream_, buffer_, *parser_, beast::bind_front_handler(&HttpSession::onRead, self<HttpSession>()));
}

/// The stream's own timeout would close the socket, so that no 408 could be written.
void HttpSession::allowTimeToRead(SteadyClock::duration time) {
  stream_.expires_never();
  is_late_ = false;
  deadline_.expires_after(time);
  deadline_.async_wait([self = self<HttpSession>()](error_code cancelled) {
    if (cancelled || !self->reading_) return;  // a timer that was ready already cannot be called off
    self->is_late_ = true;
    error_code ignored;
    self->stream_.socket().cancel(ignored);
  });
}

void HttpSession::onRead(error_code ec, std::size_t /*bytes_read*/) {
  reading_ = false;
  deadline_.cancel();
  ++requests_;
  if (ec) return onUnreadable(ec);
  // RFC 9112, sections 3.2 and 6.3: where a proxy could read the request otherwise, nobody answers it.
  const UpgradeRequest& fields = parser_->get();
  if (fields.count(http::field::host) > 1 || fields.count(http::field::transfer_encoding) > 0) {
    keep_alive_ = false;
    return doWrite(textReply(400, "the request has two Host fields, or a Transfer-Encoding\n"));
  }
  const HttpRequest request = viewOf(fields);
  readHead();
  // A kept connection would lead whoever collects metrics to the same process for ever.
  if (hub_->options.shares_port && request.path() == "/metrics") keep_alive_ = false;
  if (auto reply = hub_->answerForServer(request, head_)) return doWrite(std::move(*reply));
  if (hub_->draining) return doWrite(tryLater(kRetrySeconds, "the server stops; try again later\n"));
  if (isTurnedAway())
    return doWrite(tryLater(kRetrySeconds, "this server has as many viewers as it may; try again later\n"));
  // A proxy's connections are counted for its clients, which are known only now.
  if (client_ != peer_ && !countFor(client_.text())) {
    hub_->metrics.refused("address").add();
    keep_alive_ = false;
    return doWrite(textReply(429, "there are too many connections of your address; close others\n",
                             {{"Retry-After", std::to_string(kRetrySeconds)}}));
  }
  answer(request);
}

/// Puts together what decides who may have an answer, and who asks.
void HttpSession::readHead() {
  const UpgradeRequest& request = parser_->get();
  const auto view = [&](auto field) {
    const beast::string_view text = request[field];
    return std::string_view(text.data(), text.size());
  };
  const auto joined = [&](auto field, const char* separator) {
    std::string all;
    for (auto [it, end] = request.equal_range(field); it != end; ++it)
      all += (all.empty() ? "" : separator) + std::string(it->value());
    return all;
  };
  const TrustedProxies& proxies = hub_->security->rules.proxies();
  client_ = proxies.clientAddress(peer_, joined("X-Forwarded-For", ","));
  cookies_ = joined(http::field::cookie, ";");
  head_ = {.method = {request.method_string().data(), request.method_string().size()},
           .target = {request.target().data(), request.target().size()},
           .host = view(http::field::host),
           .origin = view(http::field::origin),
           .authorization = view(http::field::authorization),
           .cookie = cookies_,
           .fetch_site = view("Sec-Fetch-Site"),
           .fetch_mode = view("Sec-Fetch-Mode"),
           .is_upgrade = beast::websocket::is_upgrade(request),
           .is_secure = stream_.isTls() || proxies.cameByTls(peer_, joined("X-Forwarded-Proto", ","))};
}

/// Bytes that are no request get an answer that says why, as far as there were any.
void HttpSession::onUnreadable(error_code ec) {
  if (ec == http::error::end_of_stream) return shutDownSending();
  keep_alive_ = false;
  if (ec == asio::error::operation_aborted && is_late_)
    return parser_->got_some() ? doWrite(textReply(408, "the request did not come in time\n")) : shutDownSending();
  if (ec == http::error::header_limit)
    return doWrite(textReply(431, "the request's header has more than 8 KB; send fewer or shorter fields\n"));
  if (ec == http::error::body_limit) return doWrite(textReply(413, "requests have no body here\n"));
  if (ec.category() == http::make_error_code(http::error::bad_method).category() && ec != http::error::partial_message)
    return doWrite(textReply(400, "this is no HTTP request\n"));
  // A lost peer: the socket closes with the session.
}

void HttpSession::answer(HttpRequest request) {
  request.is_secure = head_.is_secure;
  std::string_view rest;
  hosted_ = hub_->findScene(head_, rest);
  if (refuse()) return;
  if (hosted_ == nullptr) return doWrite(hub_->answerForAllScenes(request, head_));
  if (rest.empty()) return doWrite(redirectToFolder(hosted_->access_name));
  request.target = rest;
  const std::string_view path = request.path();
  const bool shows_documents = path == "/scene.json" || path == "/annotations.json" || path == "/render";
  if (head_.is_upgrade || shows_documents) return answerAfresh(request);
  answerFromScene(request);
}

/// Answers a request that gets no other answer (Security::answerInstead()); false for others.
bool HttpSession::refuse() {
  auto instead = hub_->answerInstead(head_, hosted_.get());
  if (!instead) return false;
  if (const char* reason = refusalReason(*instead)) hub_->metrics.refused(reason).add();
  doWrite(std::move(*instead));
  return true;
}

/// Waits until the scene's documents were read, lest the answer be older than what `lumigrid set` has written.
void HttpSession::answerAfresh(const HttpRequest& request) {
  const std::uint64_t id = hub_->next_client++;
  const auto done =
      whenAwaited<std::monostate>(id, [request](HttpSession& session, std::monostate) { session.onFresh(request); });
  hosted_->whenFresh([done] { done({}); });
  waitForAnswer(id);
}

/// Much may have happened meanwhile: a link may have expired, a token may have been withdrawn.
void HttpSession::onFresh(const HttpRequest& request) {
  const bool is_served = std::find(hub_->scenes.begin(), hub_->scenes.end(), hosted_) != hub_->scenes.end();
  if (hub_->draining || !is_served)
    return doWrite(tryLater(kRetrySeconds, "the server stops, or the scene is replaced; try again later\n"));
  if (!refuse()) answerFromScene(request);
}

void HttpSession::answerFromScene(const HttpRequest& request) {
  const std::string_view path = request.path();
  if (head_.is_upgrade && (path == "/" || path == "/ws")) return upgradeToWebSocket();
  const bool reads = request.method == "GET" || request.method == "HEAD";
  const bool needs_patches = reads && (path == "/render" || path == "/pick");
  if (needs_patches && !hosted_->hasPatches()) return doWrite(withoutPatchesReply());
  if (reads && path == "/render") return requestPicture(request);
  if (reads && path == "/pick") return requestPick(request);
  HttpReply reply = hosted_->site->answer(request, hub_->place);
  if (reply.file.length == 0 || request.method == "HEAD") return doWrite(std::move(reply));
  reply_ = std::move(reply);
  readRange();
}

void HttpSession::upgradeToWebSocket() {
  // Beast looks whether there is a key, not at what it is.
  const beast::string_view key = parser_->get()[http::field::sec_websocket_key];
  if (!key.empty() && !isWebSocketKey({key.data(), key.size()}))
    return doWrite(textReply(400, "the handshake's key is not 16 bytes in base64\n"));
  stream_.expires_never();  // a WebSocket stream has its own timeouts
  const std::int64_t until = hub_->security->rules.accessTo(hosted_->access_name, head_, secondsNow()).until;
  is_upgraded_ = true;
  startWebSocketSession(hub_, hosted_, {address(), until}, std::move(stream_), parser_->get());
}

// ---- Answers of other threads

void HttpSession::requestPicture(const HttpRequest& request) {
  const std::uint64_t max_pixels = hub_->options.max_picture_pixels;
  if (!hub_->renderer || max_pixels == 0)
    return doWrite(textReply(501, "this server renders no pictures; they need frames and --max-picture above 0\n"));
  const auto query = parseQuery(request.target);
  if (!query) return doWrite(badRequest(query.error()));
  const auto picture = parsePictureRequest(*query, max_pixels, hosted_->scene->scene.background);
  if (!picture) return doWrite(badRequest(picture.error()));
  const char* type = contentTypeOf(picture->format);
  if (request.method == "HEAD") return doWrite(headReply(type));

  const std::uint64_t id = hub_->next_client++;
  const auto done = whenAwaited<base::Result<base::Bytes>>(
      id, [type](HttpSession& session, base::Result<base::Bytes> bytes) { session.onPicture(type, std::move(bytes)); });
  const std::string key = limitKey(address());
  PictureLimits limits = hub_->options.picture_limits;
  limits.of_one_address -= std::min(limits.of_one_address, hub_->unsent_pictures.countOf(key));
  const bool accepted = hub_->unsent_pictures.hasRoom() &&
                        hub_->renderer->requestPicture(id, key, hosted_->scene, *picture, limits, done);
  if (!accepted) {
    hub_->metrics.pictures_refused.add();
    return doWrite(tryLater(kRetrySeconds, "too many pictures are asked for at once; try again later\n"));
  }
  waitForAnswer(id);
}

void HttpSession::onPicture(const char* type, base::Result<base::Bytes> bytes) {
  (bytes ? hub_->metrics.pictures_drawn : hub_->metrics.pictures_failed).add();
  if (!bytes) return doWrite(renderErrorReply(bytes.error()));
  HttpReply reply{.type = type, .cache = "no-store", .owned = std::move(*bytes)};
  picture_.emplace(hub_->unsent_pictures, limitKey(address()), reply.owned.size());
  doWrite(std::move(reply));
}

void HttpSession::requestPick(const HttpRequest& request) {
  const auto query = parseQuery(request.target);
  if (!query) return doWrite(badRequest(query.error()));
  const auto ray = parsePickRequest(*query);
  if (!ray) return doWrite(badRequest(ray.error()));
  if (request.method == "HEAD") return doWrite(headReply("application/json"));
  const std::uint64_t id = hub_->next_client++;
  const auto done = whenAwaited<base::Result<std::string>>(id, std::mem_fn(&HttpSession::onPick));
  if (!hosted_->picker->submit(id, limitKey(address()), *ray, done))
    return doWrite(tryLater(1, "too many points are asked for at once; try again later\n"));
  waitForAnswer(id);
}

void HttpSession::onPick(base::Result<std::string> json) {
  if (!json) {
    hosted_->scene->read_errors->report("pick", json.error());
    return doWrite(tryLater(kRetrySeconds, "the scene's data cannot be read there; the server's log says more\n"));
  }
  doWrite({.type = "application/json", .cache = "no-store", .text = std::move(*json)});
}

/// Ends when the answer comes, the visitor closes the connection, or the time is over.
void HttpSession::waitForAnswer(std::uint64_t id) {
  awaited_ = id;
  stream_.expires_never();
  answer_timer_.emplace(hub_->io, kAnswerTimeout);
  answer_timer_->async_wait([self = self<HttpSession>(), id](error_code cancelled) {
    if (!cancelled) self->onAnswerTimeout(id);
  });
  // The socket becomes readable when the visitor closes it or sends the next request; the latter can wait.
  stream_.socket().async_wait(TcpSocket::wait_read, [self = self<HttpSession>(), id](error_code cancelled) {
    if (!cancelled) self->onReadable(id);
  });
}

void HttpSession::onAnswerTimeout(std::uint64_t id) {
  if (awaited_ != id) return;
  stopWaiting();
  if (header_written_) return close();
  doWrite(tryLater(kRetrySeconds, "this takes too long; ask for fewer pixels or try again later\n"));
}

void HttpSession::onReadable(std::uint64_t id) {
  if (awaited_ == id && stream_.isPeerGone()) close();
}

void HttpSession::stopWaiting() {
  if (!awaited_) return;
  if (hub_->renderer) hub_->renderer->cancel(*awaited_);
  if (hosted_ && hosted_->picker) hosted_->picker->cancel(*awaited_);
  if (hosted_) hosted_->fetchers->drop(fetch_client_);
  awaited_.reset();
  answer_timer_->cancel();
  error_code ignored;
  stream_.socket().cancel(ignored);
}

/// A scene that is no longer served lives as long as somebody holds it.
void HttpSession::leaveScene() {
  if (hosted_) hosted_->fetchers->forget(fetch_client_);
  hosted_.reset();
}

// ---- Bodies of the scene's files

void HttpSession::readRange() {
  const FileBody& body = reply_.file;
  const std::uint64_t id = hub_->next_client++;
  hosted_->fetchers->submit(
      fetch_client_,
      [done = whenAwaited<base::Result<base::Bytes>>(id, std::mem_fn(&HttpSession::onRange)), hub = hub_.get(),
       source = body.source, name = body.name, offset = body.offset, length = std::min(body.length, kMaxRange)] {
        if (!hub->stopping) done(source->read(name, offset, length));
      });
  waitForAnswer(id);
}

void HttpSession::onRange(base::Result<base::Bytes> bytes) {
  if (!bytes) {
    hosted_->scene->read_errors->report("download", bytes.error());
    return header_written_ ? close() : doWrite(fileErrorReply(bytes.error()));
  }
  reply_.owned = std::move(*bytes);
  if (!header_written_) return doWrite(std::move(reply_));
  unwritten_ = reply_.owned;
  writePiece();
}

// ---- Writing answers

void HttpSession::doWrite(HttpReply reply) {
  const UpgradeRequest& request = parser_->get();
  reply_ = std::move(reply);
  response_.emplace();
  setFields(request);
  hub_->metrics.answers(reply_.status).add();
  const bool is_file = reply_.file.length > 0;
  const base::ByteView body = is_file ? base::ByteView(reply_.owned) : reply_.body();
  const bool bodiless = reply_.status == 204 || reply_.status == 304;
  if (reply_.has_length && !bodiless) response_->content_length(is_file ? reply_.file.length : body.size());

  const bool is_head = request.method() == http::verb::head;
  const bool in_pieces = !is_head && (is_file || body.size() > kMaxPiece);
  if (!in_pieces) response_->body() = {body.data(), body.size()};
  allowTimeToWrite(in_pieces ? 0 : body.size());
  serializer_.emplace(*response_);
  if (in_pieces) {
    header_written_ = true;
    unwritten_ = body;
    return http::async_write_header(stream_, *serializer_,
                                    beast::bind_front_handler(&HttpSession::onHeader, self<HttpSession>()));
  }
  auto handler = beast::bind_front_handler(&HttpSession::onWrite, self<HttpSession>());
  if (is_head) return http::async_write_header(stream_, *serializer_, std::move(handler));
  http::async_write(stream_, *serializer_, std::move(handler));
}

void HttpSession::onHeader(error_code ec, std::size_t bytes_written) {
  if (ec) return onWrite(ec, bytes_written);
  hub_->metrics.http_bytes.add(bytes_written);
  writePiece();
}

void HttpSession::writePiece() {
  const base::ByteView piece = unwritten_.first(std::min(unwritten_.size(), kMaxPiece));
  allowTimeToWrite(piece.size());
  asio::async_write(stream_, asio::buffer(piece.data(), piece.size()),
                    beast::bind_front_handler(&HttpSession::onPiece, self<HttpSession>()));
}

void HttpSession::onPiece(error_code ec, std::size_t bytes_written) {
  unwritten_ = unwritten_.subspan(bytes_written);
  FileBody& file = reply_.file;
  const std::uint64_t of_file = std::min<std::uint64_t>(file.length, bytes_written);  // 0 where the body is no file's
  file.offset += of_file;
  file.length -= of_file;
  if (ec || (unwritten_.empty() && file.length == 0)) return onWrite(ec, bytes_written);
  hub_->metrics.http_bytes.add(bytes_written);
  if (unwritten_.empty()) return readRange();
  writePiece();
}

void HttpSession::setFields(const UpgradeRequest& request) {
  auto& fields = *response_;
  fields.result(static_cast<unsigned>(reply_.status));
  fields.version(request.version());
  fields.keep_alive(keep_alive_ && request.keep_alive() && !isTurnedAway() && !hub_->draining && !hub_->stopping &&
                    reply_.has_length);
  fields.set(http::field::server, "lumigrid");
  fields.set(http::field::content_type, reply_.type);
  fields.set(http::field::cache_control, hub_->security->cacheControl(reply_.cache));
  fields.set("X-Content-Type-Options", "nosniff");
  fields.set("Referrer-Policy", "no-referrer");  // an address may hold a credential
  for (const auto& [name, value] : reply_.headers) fields.set(name, value);
  for (const auto& [name, value] : hub_->security->rules.origins().fields(head_)) fields.insert(name, value);
}

void HttpSession::allowTimeToWrite(std::size_t bytes) {
  const double seconds = hub_->options.stall_seconds + static_cast<double>(bytes) / hub_->options.min_bytes_per_second;
  stream_.expires_after(durationOf(seconds));
}

void HttpSession::onWrite(error_code ec, std::size_t bytes_written) {
  hub_->metrics.http_bytes.add(bytes_written);
  picture_.reset();
  unwritten_ = {};
  reply_ = {};
  header_written_ = false;
  if (ec) return;
  if (!keep_alive_) return closeBehindTheRest();
  if (!response_->keep_alive() || hub_->draining) return shutDownSending();
  doRead();
}

void HttpSession::shutDownSending() {
  stream_.shutDownSending();
}

/// Closing with bytes of a request unread would have the system reset the connection, and the peer could lose the
/// answer. So what still comes is read, as far as a peer that was refused may take time and bytes.
void HttpSession::closeBehindTheRest() {
  shutDownSending();
  stream_.expires_never();
  stream_.next_layer().expires_after(kTurnedAwayTimeout);
  discard();
}

void HttpSession::discard() {
  constexpr std::size_t kPiece = 16 * 1024;
  buffer_.clear();
  stream_.next_layer().async_read_some(buffer_.prepare(kPiece),
                                       [self = self<HttpSession>()](error_code ec, std::size_t bytes) {
                                         self->discarded_ += bytes;
                                         if (!ec && self->discarded_ < kMaxDiscarded) self->discard();
                                       });
}

void HttpSession::close() {
  stopWaiting();
  deadline_.cancel();
  stream_.close();
}

}  // namespace

void startHttpSession(std::shared_ptr<Hub> hub, TcpSocket&& socket, const std::string& address, bool turned_away) {
  std::make_shared<HttpSession>(std::move(hub), std::move(socket), address, turned_away)->start();
}

}  // namespace server
