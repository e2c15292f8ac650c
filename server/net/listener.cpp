#include "server/net/listener.h"

#include <string>
#include <utility>

#include "server/net/http_session.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

// After an accept that failed, e.g. for want of file descriptors: trying again at once would spin.
constexpr auto kAcceptPause = std::chrono::milliseconds(100);

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

Listener::Listener(asio::io_context& io, std::shared_ptr<Hub> hub)
    : hub_(std::move(hub)), acceptor_(io), incoming_(io), pause_(io) {}

base::Result<void> Listener::bind() {
  const ServerOptions& options = hub_->options;
  error_code ec;
  const auto address = asio::ip::make_address(options.address, ec);
  if (ec)
    return base::Error{base::ErrorCode::kInvalidInput,
                       "'" + options.address +
                           "' is no IP address; use 127.0.0.1 for this machine alone or 0.0.0.0 for all its networks"};
  const Tcp::endpoint endpoint(address, options.port);
  acceptor_.open(endpoint.protocol(), ec);
  if (!ec) acceptor_.set_option(asio::socket_base::reuse_address(true), ec);
  if (!ec) acceptor_.bind(endpoint, ec);
  if (!ec) acceptor_.listen(asio::socket_base::max_listen_connections, ec);
  if (ec) return bindError(options.address, options.port, ec);
  hub_->place = options.address + ":" + std::to_string(port());
  return {};
}

void Listener::doAccept() {
  acceptor_.async_accept(incoming_, [this](error_code ec) { onAccept(ec); });
}

void Listener::onAccept(error_code ec) {
  if (hub_->stopping || ec == asio::error::operation_aborted) return;
  if (ec) {
    spdlog::warn("accept: {}", ec.message());
    return acceptAfterPause();
  }
  const std::size_t open = hub_->connections.size();
  const bool turned_away = open >= hub_->options.max_connections;
  if (turned_away) spdlog::warn("turn away: {} connections are open", open);
  TcpSocket socket(std::move(incoming_));  // incoming_ is as new afterwards
  if (open < std::size_t{hub_->options.max_connections} + kMaxTurnedAway)
    startHttpSession(hub_, std::move(socket), turned_away);
  doAccept();
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
