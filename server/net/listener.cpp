#include "server/net/listener.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <string>
#include <string_view>
#include <utility>

#include "server/net/http_session.h"
#include "server/net/http_text.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

// After an accept that failed, e.g. for want of file descriptors: trying again at once would spin.
constexpr auto kAcceptPause = std::chrono::milliseconds(100);

const std::string& fullAnswer() {
  static const std::string answer =
      closingAnswer("503 Service Unavailable", "this server has as many connections as it may; try again later\n");
  return answer;
}

const std::string& tooManyAnswer() {
  static const std::string answer =
      closingAnswer("429 Too Many Requests", "there are too many connections of your address; close others\n");
  return answer;
}

/// Answers whoever it is without waiting for a request, as far as the kernel takes it at once.
void answerAndClose(int socket, std::string_view answer) {
  ::send(socket, answer.data(), answer.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
  ::shutdown(socket, SHUT_WR);
  // Closing with bytes unread would reset the connection, and the peer could lose the answer.
  std::array<char, 4096> unread;
  while (::recv(socket, unread.data(), unread.size(), MSG_DONTWAIT) > 0) {
  }
}

base::FileDescriptor openSpare() {
  return base::FileDescriptor(::open("/dev/null", O_RDONLY | O_CLOEXEC));
}

base::Error bindError(const std::string& address, std::uint16_t port, error_code ec) {
  const std::string place = placeText(address, port);
  if (ec == asio::error::address_in_use)
    return {base::ErrorCode::kNetwork, place + " is in use; choose another port with --port (0 picks a free one)"};
  if (ec == asio::error::access_denied)
    return {base::ErrorCode::kNetwork,
            place + ": not allowed; ports below 1024 need privileges, choose another with --port"};
  return {base::ErrorCode::kNetwork,
          "cannot listen at " + place + ": " + ec.message() + "; choose another address with --address"};
}

}  // namespace

Listener::Listener(asio::io_context& io, std::shared_ptr<Hub> hub)
    : hub_(std::move(hub)), acceptor_(io), incoming_(io), pause_(io), spare_(openSpare()) {}

base::Result<void> Listener::checkAddress() const {
  error_code ec;
  asio::ip::make_address(hub_->options.address, ec);
  if (!ec) return {};
  return base::Error{base::ErrorCode::kInvalidInput,
                     "'" + hub_->options.address +
                         "' is no IP address; use 127.0.0.1 for this machine alone or 0.0.0.0 for all its networks"};
}

base::Result<void> Listener::bind() {
  LUMIGRID_TRY(checkAddress());
  const ServerOptions& options = hub_->options;
  error_code ec;
  const auto address = asio::ip::make_address(options.address, ec);
  const Tcp::endpoint endpoint(address, options.port);
  acceptor_.open(endpoint.protocol(), ec);
  if (!ec) acceptor_.set_option(asio::socket_base::reuse_address(true), ec);
  using ReusePort = asio::detail::socket_option::boolean<SOL_SOCKET, SO_REUSEPORT>;
  if (!ec && options.shares_port) acceptor_.set_option(ReusePort(true), ec);
  if (!ec) acceptor_.bind(endpoint, ec);
  if (!ec) acceptor_.listen(asio::socket_base::max_listen_connections, ec);
  if (ec) return bindError(options.address, options.port, ec);
  hub_->place = placeText(options.address, port());
  return {};
}

void Listener::doAccept() {
  acceptor_.async_accept(incoming_, [this](error_code ec) { onAccept(ec); });
}

void Listener::onAccept(error_code ec) {
  // A peer that was accepted already, before the port was closed, would begin to accept again.
  if (hub_->stopping || !acceptor_.is_open() || ec == asio::error::operation_aborted) return;
  if (ec) {
    spdlog::warn("accept: {}", ec.message());
    if (ec == asio::error::no_descriptors) refuseOne();
    return acceptAfterPause();
  }
  startSession(TcpSocket(std::move(incoming_)));  // incoming_ is as new afterwards
  doAccept();
}

void Listener::startSession(TcpSocket socket) {
  error_code ec;
  const auto peer = socket.remote_endpoint(ec);
  if (ec) return;  // it has gone already
  const std::string address = peer.address().to_string();
  const ServerOptions& options = hub_->options;
  const std::size_t open = hub_->connections.size();
  const bool is_proxy = hub_->security->rules.proxies().contains(parseIpAddress(address).value_or(IpAddress()));
  const auto of_address = hub_->connections_of.find(limitKey(address));
  if (!is_proxy && of_address != hub_->connections_of.end() && of_address->second >= options.connections_per_address) {
    spdlog::warn("turn away: {} connections of {} are open", of_address->second, address);
    hub_->metrics.refused("address").add();
    return refuse(socket.native_handle(), tooManyAnswer());
  }
  const bool is_full = open >= options.max_connections;
  if (is_full) {
    spdlog::warn("turn away: {} connections are open", open);
    hub_->metrics.refused("connections").add();
  }
  const bool turned_away = is_full || hub_->draining;
  const auto turned_away_of = hub_->turned_away_of.find(limitKey(address));
  const bool has_its_share = !is_proxy && turned_away && turned_away_of != hub_->turned_away_of.end() &&
                             turned_away_of->second >= kMaxTurnedAwayOfAddress;
  if (has_its_share || open >= std::size_t{options.max_connections} + kMaxTurnedAway)
    return refuse(socket.native_handle(), fullAnswer());
  startHttpSession(hub_, std::move(socket), address, turned_away);
}

/// A peer that waits in the queue of the kernel would be told nothing.
void Listener::refuseOne() {
  hub_->metrics.refused("descriptors").add();
  spare_ = base::FileDescriptor();
  const base::FileDescriptor peer(::accept4(acceptor_.native_handle(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
  if (peer) refuse(peer.get(), fullAnswer());
  spare_ = openSpare();
}

/// A peer that speaks TLS would not understand, and a handshake for it would cost what it is refused for.
void Listener::refuse(int socket, const std::string& answer) const {
  if (!hub_->security->tls) answerAndClose(socket, answer);
}

void Listener::acceptAfterPause() {
  pause_.expires_after(kAcceptPause);
  pause_.async_wait([this](error_code cancelled) {
    if (!cancelled) doAccept();
  });
}

void Listener::close() {
  error_code ignored;
  acceptor_.close(ignored);
  pause_.cancel();
}

std::uint16_t Listener::port() const {
  error_code ignored;
  return acceptor_.local_endpoint(ignored).port();
}

}  // namespace server
