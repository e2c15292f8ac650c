#pragma once
// The port of a server: accepts connections and starts an HTTP session for each.
#include <cstdint>
#include <memory>
#include <string>

#include "base/error.h"
#include "base/file.h"
#include "server/net/asio_types.h"
#include "server/net/hub.h"

#include <boost/asio/basic_socket_acceptor.hpp>

namespace server {

class Listener {
 public:
  Listener(asio::io_context& io, std::shared_ptr<Hub> hub);
  /// Whether the address of the hub's options is one.
  base::Result<void> checkAddress() const;
  /// Binds the address and port of the hub's options and sets Hub::place. Errors say which other option to choose.
  base::Result<void> bind();
  /// Starts to accept; every callback runs on the io thread.
  void start() { doAccept(); }
  void close();
  std::uint16_t port() const;

 private:
  void doAccept();
  void onAccept(error_code ec);
  void startSession(TcpSocket socket);
  void refuse(int socket, const std::string& answer) const;
  void acceptAfterPause();
  void refuseOne();

  const std::shared_ptr<Hub> hub_;
  asio::basic_socket_acceptor<Tcp, Executor> acceptor_;
  TcpSocket incoming_;
  SteadyTimer pause_;
  base::FileDescriptor spare_;  // given up for a moment to refuse a peer when there is no other descriptor left
};

}  // namespace server
