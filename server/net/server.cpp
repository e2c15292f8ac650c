#include "server/net/server.h"

#include <boost/asio/post.hpp>
#include <boost/asio/signal_set.hpp>
#include <csignal>
#include <optional>
#include <utility>

#include "server/net/connection.h"
#include "server/net/hub.h"
#include "server/net/listener.h"
#include "spdlog/spdlog.h"

namespace server {

struct Server::Impl {
  explicit Impl(const ServerOptions& options) : hub(std::make_shared<Hub>(io, options)), listener(io, hub) {}
  ~Impl() { endThreads(); }

  base::Result<void> listenForSignals();
  void shutDown();
  void endThreads();

  asio::io_context io{1};
  std::shared_ptr<Hub> hub;
  Listener listener;
  std::optional<asio::basic_signal_set<Executor>> signals;
  std::optional<SteadyTimer> close_timer;
};

base::Result<std::unique_ptr<Server>> Server::open(const std::vector<std::string>& scenes,
                                                   const ServerOptions& options) {
  std::unique_ptr<Server> server(new Server);
  server->impl_ = std::make_unique<Impl>(options);
  Hub& hub = *server->impl_->hub;
  LUMIGRID_TRY(hub.openScenes(scenes));
  LUMIGRID_TRY(server->impl_->listener.bind());
  if (options.count_access)
    for (std::size_t i = 0; i < scenes.size(); ++i) hub.scenes[i]->startAccessLog(options, scenes[i]);
  if (options.render_frames) hub.startRenderer();
  return server;
}

Server::~Server() = default;

std::uint16_t Server::port() const {
  return impl_->listener.port();
}

std::vector<std::string> Server::names() const {
  std::vector<std::string> names;
  for (const auto& hosted : impl_->hub->scenes) names.push_back(hosted->name);
  return names;
}

base::Result<void> Server::run(bool handle_signals) {
  if (handle_signals) LUMIGRID_TRY(impl_->listenForSignals());
  impl_->listener.start();
  impl_->io.run();
  impl_->endThreads();
  return {};
}

void Server::stop() {
  asio::post(impl_->io, [this] { impl_->shutDown(); });
}

base::Result<void> Server::Impl::listenForSignals() {
  signals.emplace(io);
  error_code ec;
  signals->add(SIGINT, ec);
  if (!ec) signals->add(SIGTERM, ec);
  if (ec) return base::Error{base::ErrorCode::kIo, "cannot listen for SIGINT and SIGTERM: " + ec.message()};
  signals->async_wait([this](error_code cancelled, int) {
    if (!cancelled) shutDown();
  });
  return {};
}

void Server::Impl::shutDown() {
  if (hub->stopping) return;
  hub->stopping = true;
  spdlog::info("stopping: {} connections are open", hub->connections.size());
  error_code ignored;
  listener.close();
  if (signals) signals->cancel(ignored);

  // A copy of the list, since closing may end a connection at once.
  std::vector<std::shared_ptr<Connection>> open;
  for (Connection* connection : hub->connections) open.push_back(connection->shared_from_this());
  if (open.empty()) return;
  constexpr auto kCloseTimeout = std::chrono::seconds(2);  // for viewers to answer the close frame
  close_timer.emplace(io, kCloseTimeout);
  close_timer->async_wait([this](error_code cancelled) {
    if (!cancelled) io.stop();
  });
  hub->on_last_connection_closed = [this] { close_timer->cancel(); };
  for (const auto& connection : open) connection->closeForShutdown();
}

/// Connections that did not close in time are destroyed with `io`, after all else: nothing may wait for them.
void Server::Impl::endThreads() {
  hub->on_last_connection_closed = nullptr;
  close_timer.reset();
  hub->endThreads();
  hub->endAccessLogs();
}

}  // namespace server
