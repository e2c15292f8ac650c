#pragma once
// One viewer: a WebSocket with a protocol Session that workers run (session_runner.h). Reads and writes run side by
// side. The io thread only passes messages on: it plans nothing, reads no disk, waits for nobody.
#include "server/net/asio_types.h"

#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <cstdint>
#include <memory>
#include <string>

#include "base/tls/any_stream.h"
#include "server/net/hub.h"

namespace server {

// The Beast types that an HTTP session hands over. Only these two files include Beast (asio_types.h says why).
namespace beast = boost::beast;
namespace http = beast::http;
using AnyStream = base::AnyStream<Executor>;  ///< TCP, or TLS on it
using UpgradeRequest = http::request<http::empty_body>;

/// The client that asks for the upgrade.
struct Visitor {
  std::string address;          ///< without a port; of the client itself where it comes by a trusted proxy
  std::int64_t until = kNoEnd;  ///< Unix seconds from which on it may not see the scene
};

/// Answers the upgrade and serves the viewer.
void startWebSocketSession(std::shared_ptr<Hub> hub, std::shared_ptr<HostedScene> hosted, const Visitor& visitor,
                           AnyStream&& stream, const UpgradeRequest& upgrade);

}  // namespace server
