#pragma once
// One viewer: a WebSocket with a protocol Session that workers run (session_runner.h). Reads and writes run side by
// side. The io thread only passes messages on: it plans nothing, reads no disk, waits for nobody.
#include "server/net/asio_types.h"

#include <boost/beast/core/basic_stream.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <memory>
#include <string>

#include "server/net/hub.h"

namespace server {

// The Beast types that an HTTP session hands over. Only these two files include Beast (asio_types.h says why).
namespace beast = boost::beast;
namespace http = beast::http;
using BeastStream = beast::basic_stream<Tcp, Executor>;
using UpgradeRequest = http::request<http::empty_body>;

/// Answers the upgrade and serves the viewer. `address`: the peer's.
void startWebSocketSession(std::shared_ptr<Hub> hub, std::shared_ptr<HostedScene> hosted, const std::string& address,
                           BeastStream&& stream, const UpgradeRequest& upgrade);

}  // namespace server
