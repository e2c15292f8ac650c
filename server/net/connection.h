#pragma once
// The base class of HTTP and WebSocket sessions.
#include <boost/asio/post.hpp>
#include <memory>
#include <string>
#include <utility>

#include "server/auth/client_address.h"
#include "server/net/hub.h"

namespace server {

/// A connection lives as long as one of its operations is pending.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  /// `address`: the client's, without a port.
  Connection(std::shared_ptr<Hub> hub, std::string address)
      : hub_(std::move(hub)), address_(std::move(address)), came_while_draining_(hub_->draining) {
    hub_->connections.insert(this);
    if (!came_while_draining_) ++hub_->connections_to_finish;
    ++hub_->connections_of[limitKey(address_)];
  }
  virtual ~Connection() {
    hub_->connections.erase(this);
    uncount();
    if (came_while_draining_) return;
    if (--hub_->connections_to_finish == 0 && hub_->on_last_connection_closed) hub_->on_last_connection_closed();
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;
  /// Called once when the server stops: says goodbye where the protocol has one, and closes.
  virtual void closeForShutdown() = 0;
  /// Called once when the server drains: closes as soon as what is under way is done.
  virtual void closeForDrain() { closeForShutdown(); }
  /// Called when scene() is no longer served, or another one in its place.
  virtual void closeForOtherScene() { closeForDrain(); }
  /// The scene that the connection is about; null: none.
  virtual const HostedScene* scene() const = 0;

 protected:
  /// The pointer that a pending operation holds.
  template <class Self>
  std::shared_ptr<Self> self() {
    return std::static_pointer_cast<Self>(shared_from_this());
  }
  /// For another thread to call: hands its answer to accept(session, answer) on the io thread, if the session is still
  /// there.
  template <class Answer, class Self, class Accept>
  auto answerTo(Self* /*session*/, Accept accept) {
    return [weak = weak_from_this(), accept, &io = hub_->io](Answer answer) {
      boost::asio::post(io, [weak, accept, answer = std::move(answer)]() mutable {
        if (const auto session = std::static_pointer_cast<Self>(weak.lock())) accept(*session, std::move(answer));
      });
    };
  }
  /// Counts this connection for a client in place of the proxy that passed it on. Returns whether the client may have
  /// so many.
  bool countFor(const std::string& address) {
    if (address != address_) {
      ++hub_->connections_of[limitKey(address)];
      uncount();
      address_ = address;
    }
    return hub_->connections_of[limitKey(address_)] <= hub_->options.connections_per_address;
  }
  const std::string& address() const { return address_; }
  const std::shared_ptr<Hub> hub_;

 private:
  void uncount() {
    if (const auto it = hub_->connections_of.find(limitKey(address_)); --it->second == 0)
      hub_->connections_of.erase(it);
  }
  std::string address_;
  const bool came_while_draining_;
};

}  // namespace server
