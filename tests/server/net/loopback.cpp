#include <utility>
//
#include "tests/server/net/loopback.h"

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <cctype>
#include <thread>

namespace server {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using boost::system::error_code;

constexpr auto kPatience = std::chrono::seconds(10);

asio::ip::tcp::endpoint endpointOf(std::uint16_t port) {
  return {asio::ip::address_v4::loopback(), port};
}

/// Starts an asynchronous operation and runs until its handler was called.
template <class Start>
error_code await(asio::io_context& io, Start start) {
  error_code result;
  bool done = false;
  start([&](error_code ec, auto&&...) {
    result = ec;
    done = true;
  });
  io.restart();
  while (!done && io.run_one() != 0) {
  }
  return result;
}

std::string lowerCase(beast::string_view text) {
  std::string lower(text.data(), text.size());
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return lower;
}

}  // namespace

HttpAnswer httpRequest(std::uint16_t port, const std::string& target, const std::map<std::string, std::string>& headers,
                       const std::string& method) {
  asio::io_context io;
  beast::tcp_stream stream(io);
  stream.expires_after(kPatience);
  if (await(io, [&](auto handler) { stream.async_connect(endpointOf(port), handler); })) return {};

  http::request<http::empty_body> request;
  request.method_string(method);
  request.target(target);
  request.version(11);
  request.set(http::field::host, "127.0.0.1:" + std::to_string(port));
  request.set(http::field::connection, "close");
  for (const auto& [name, value] : headers) request.set(name, value);
  if (await(io, [&](auto handler) { http::async_write(stream, request, handler); })) return {};

  beast::flat_buffer buffer;
  http::response_parser<http::string_body> parser;
  parser.skip(method == "HEAD");
  if (await(io, [&](auto handler) { http::async_read(stream, buffer, parser, handler); })) return {};
  HttpAnswer answer;
  answer.status = static_cast<int>(parser.get().result_int());
  answer.body = parser.get().body();
  for (const auto& field : parser.get()) answer.headers[lowerCase(field.name_string())] = std::string(field.value());
  return answer;
}

HttpAnswer askAndLeave(std::uint16_t port, const std::string& target) {
  asio::io_context io;
  beast::tcp_stream stream(io);
  stream.expires_after(kPatience);
  if (await(io, [&](auto handler) { stream.async_connect(endpointOf(port), handler); })) return {};
  const std::string request = "GET " + target + " HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n";
  await(io, [&](auto handler) { asio::async_write(stream, asio::buffer(request), handler); });
  return {};
}

std::string rawExchange(std::uint16_t port, const std::string& bytes) {
  asio::io_context io;
  beast::tcp_stream stream(io);
  stream.expires_after(kPatience);
  if (await(io, [&](auto handler) { stream.async_connect(endpointOf(port), handler); })) return {};
  await(io, [&](auto handler) { asio::async_write(stream, asio::buffer(bytes), handler); });
  std::string answer;
  await(io, [&](auto handler) { asio::async_read(stream, asio::dynamic_buffer(answer), handler); });
  return answer;
}

struct LoopbackClient::State {
  asio::io_context io;
  websocket::stream<beast::tcp_stream> socket{io};
};

std::unique_ptr<LoopbackClient> LoopbackClient::connect(std::uint16_t port, const std::string& path,
                                                        int receive_buffer) {
  std::unique_ptr<LoopbackClient> client(new LoopbackClient);
  client->state_ = std::make_unique<State>();
  State& s = *client->state_;
  auto& tcp = beast::get_lowest_layer(s.socket);
  error_code ec;
  tcp.socket().open(asio::ip::tcp::v4(), ec);
  if (receive_buffer != 0) tcp.socket().set_option(asio::socket_base::receive_buffer_size(receive_buffer), ec);
  tcp.expires_after(kPatience);
  if (await(s.io, [&](auto handler) { tcp.async_connect(endpointOf(port), handler); })) return nullptr;
  tcp.expires_never();
  s.socket.set_option(websocket::stream_base::timeout{kPatience, kPatience, false});
  s.socket.read_message_max(protocol::kMaxServerMessage);
  if (await(s.io, [&](auto handler) { s.socket.async_handshake("127.0.0.1:" + std::to_string(port), path, handler); }))
    return nullptr;
  return client;
}

LoopbackClient::~LoopbackClient() = default;

bool LoopbackClient::sendBytes(const base::Bytes& bytes, bool binary) {
  state_->socket.binary(binary);
  return !await(state_->io, [&](auto handler) { state_->socket.async_write(asio::buffer(bytes), handler); });
}

std::optional<protocol::ServerMessage> LoopbackClient::receive() {
  beast::flat_buffer buffer;
  if (await(state_->io, [&](auto handler) { state_->socket.async_read(buffer, handler); })) return std::nullopt;
  auto message = protocol::decodeServerMessage({static_cast<const std::uint8_t*>(buffer.data().data()), buffer.size()});
  if (!message) return std::nullopt;
  return std::move(*message);
}

int LoopbackClient::closeCode() const {
  return state_->socket.reason().code;
}
std::string LoopbackClient::closeReason() const {
  return std::string(state_->socket.reason().reason.c_str());
}

void LoopbackClient::close() {
  await(state_->io, [&](auto handler) { state_->socket.async_close(websocket::close_code::normal, handler); });
}

namespace {

/// One client of a PlainSender.
class PlainConnection : public std::enable_shared_from_this<PlainConnection> {
 public:
  PlainConnection(asio::ip::tcp::socket socket, const std::vector<std::vector<base::Bytes>>& answers)
      : socket_(std::move(socket)), answers_(answers) {
    beast::get_lowest_layer(socket_).socket().set_option(asio::ip::tcp::no_delay(true));
    socket_.binary(true);
    socket_.auto_fragment(false);
  }
  void start() {
    socket_.async_accept([self = shared_from_this()](error_code ec) {
      if (!ec) self->read();
    });
  }

 private:
  void read() {
    socket_.async_read(incoming_, [self = shared_from_this()](error_code ec, std::size_t) {
      if (ec) return;
      self->incoming_.clear();
      self->answer_ = self->requests_++ % self->answers_.size();
      self->next_ = 0;
      self->write();
    });
  }
  void write() {
    if (next_ == answers_[answer_].size()) return read();
    socket_.async_write(asio::buffer(answers_[answer_][next_++]),
                        [self = shared_from_this()](error_code ec, std::size_t) {
                          if (!ec) self->write();
                        });
  }

  websocket::stream<beast::tcp_stream> socket_;
  const std::vector<std::vector<base::Bytes>>& answers_;
  beast::flat_buffer incoming_;
  std::size_t requests_ = 0, answer_ = 0, next_ = 0;
};

}  // namespace

struct PlainSender::State {
  explicit State(std::vector<std::vector<base::Bytes>> sent) : answers(std::move(sent)), acceptor(io, endpointOf(0)) {
    accept();
  }
  void accept() {
    acceptor.async_accept([this](error_code ec, asio::ip::tcp::socket socket) {
      if (ec) return;
      std::make_shared<PlainConnection>(std::move(socket), answers)->start();
      accept();
    });
  }

  const std::vector<std::vector<base::Bytes>> answers;
  asio::io_context io{1};
  asio::ip::tcp::acceptor acceptor;
  std::thread thread;
};

PlainSender::PlainSender(std::vector<std::vector<base::Bytes>> answers)
    : state_(std::make_unique<State>(std::move(answers))) {
  state_->thread = std::thread([this] { state_->io.run(); });
}

PlainSender::~PlainSender() {
  state_->io.stop();
  state_->thread.join();
}

std::uint16_t PlainSender::port() const {
  return state_->acceptor.local_endpoint().port();
}

}  // namespace server
