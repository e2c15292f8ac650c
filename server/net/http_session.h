#pragma once
// Plain HTTP on one connection: what the site answers at once, what other threads answer later, or the upgrade to a
// WebSocket session.
#include <memory>
#include <string>

#include "server/net/asio_types.h"
#include "server/net/hub.h"

namespace server {

/// Starts to read requests. `address`: the peer's. `turned_away`: the server is full or drains, and every request but
/// those for its health is answered with a 503.
void startHttpSession(std::shared_ptr<Hub> hub, TcpSocket&& socket, const std::string& address, bool turned_away);

}  // namespace server
