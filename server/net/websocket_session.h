#pragma once
// One viewer: a WebSocket with a protocol Session. Reads and writes run side by side; the next message is chosen when
// the one before it was written.
#include "server/net/asio_types.h"

#include <boost/beast/core/basic_stream.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <memory>

#include "server/net/hub.h"

namespace server {

// The Beast types that an HTTP session hands over. Only these two files include Beast (asio_types.h says why).
namespace beast = boost::beast;
namespace http = beast::http;
using BeastStream = beast::basic_stream<Tcp, Executor>;
using UpgradeRequest = http::request<http::empty_body>;

/// Answers the upgrade and serves the viewer. `hosted` outlives the session.
void startWebSocketSession(std::shared_ptr<Hub> hub, const HostedScene& hosted, BeastStream&& stream,
                           const UpgradeRequest& upgrade);

}  // namespace server
