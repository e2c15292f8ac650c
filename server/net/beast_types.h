#pragma once
// The Beast types that an HTTP session hands to a WebSocket session. Included by those two files only (asio_types.h
// says why).
#include "server/net/asio_types.h"

#include <boost/beast/core/basic_stream.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>

namespace server {

namespace beast = boost::beast;
namespace http = beast::http;
using BeastStream = beast::basic_stream<Tcp, Executor>;
using UpgradeRequest = http::request<http::empty_body>;

}  // namespace server
