#pragma once
// Names for the Asio types of the server. Nothing of Beast is included here: a file that includes it costs tens of CPU
// seconds, and only http_session.cpp and websocket_session.cpp need it.
#include <utility>  // before Asio: Boost 1.74 uses std::exchange without it, which gcc 12 refuses

#include <boost/asio/basic_waitable_timer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <chrono>

namespace server {

namespace asio = boost::asio;
using boost::system::error_code;
using Tcp = asio::ip::tcp;
using Executor = asio::io_context::executor_type;  ///< the concrete type: any_io_executor compiles and runs slower
using TcpSocket = asio::basic_stream_socket<Tcp, Executor>;
using SteadyClock = std::chrono::steady_clock;
using SteadyTimer = asio::basic_waitable_timer<SteadyClock, asio::wait_traits<SteadyClock>, Executor>;

}  // namespace server
