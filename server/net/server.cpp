#include "server/net/server.h"

#include <sys/resource.h>

#include <algorithm>
#include <boost/asio/post.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/system/system_error.hpp>
#include <csignal>
#include <filesystem>
#include <optional>
#include <tuple>
#include <utility>

#include "server/net/connection.h"
#include "server/net/hub.h"
#include "server/net/listener.h"
#include "spdlog/spdlog.h"

namespace server {

struct Server::Impl {
  explicit Impl(const ServerOptions& options) : hub(std::make_shared<Hub>(io, options)), listener(io, hub) {}

  base::Result<void> listenForSignals();
  void waitForSignal();
  void onSignal(int signal);
  using Places = std::vector<std::string>;
  using ReadSecurity = base::Result<std::shared_ptr<const Security>>;
  void reload();
  void readAgain();
  void takeUpReload(std::optional<Places> places, ReadSecurity read);
  void openWanted();
  void limitConnections();
  struct Opened {
    base::Result<Hub::Scenes> scenes;
    Hub::RendererPointer renderer;  // null: none was wanted, or there is none
  };
  void readNewTokens(std::shared_ptr<Opened> opened);
  void takeUp(Opened opened, ReadSecurity read);
  void drain();
  void shutDown();
  using Close = void (Connection::*)();
  void closeConnections(double seconds, std::function<void()> too_late, Close close);
  void closeEach(Close close) const;
  void finish();
  void endThreads();

  asio::io_context io{1};
  std::shared_ptr<Hub> hub;
  Listener listener;
  std::optional<asio::basic_signal_set<Executor>> signals;
  std::optional<SteadyTimer> close_timer;
  OnReload on_reload;
  std::optional<Places> wanted_places;  // of the newest reload, while an older one goes on
  bool is_opening = false;
  bool is_reading = false, is_reload_wanted = false;  // the files of a reload; another one came meanwhile
  bool has_ended = false, hangs = false;
  std::uint32_t wanted_connections = 0;
  std::size_t files_of_scene = 0;  // those that a scene keeps open, by the mean of the first ones
  // They wait for disks in place of the io thread. Scenes may take long to open; who may see them changes meanwhile.
  FairQueue opener{1}, file_reader{1};
};

namespace {

/// Descriptors besides those of connections and scenes: the renderer's, caches, the log.
constexpr rlim_t kOtherDescriptors = 128;

// At the end. Reads that are answered at all are much shorter; the file of counts may be locked for five seconds.
constexpr double kEndSeconds = 5.0, kAccessSeconds = 7.0;

/// Lets this process have as many descriptors as it can.
void raiseDescriptorLimit() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max;
  ::setrlimit(RLIMIT_NOFILE, &limit);
}

/// The descriptors of this process; 0 where the system does not tell.
std::size_t openDescriptors() {
  std::error_code failed;
  std::filesystem::directory_iterator it("/proc/self/fd", failed);
  std::size_t count = 0;
  for (; !failed && it != std::filesystem::directory_iterator(); it.increment(failed)) ++count;
  return count;
}

/// The connections that the system has descriptors for, besides those of `scenes` that keep so many files open each.
std::uint32_t connectionsPossible(std::uint32_t wanted, std::size_t scenes, std::size_t files_of_scene) {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return wanted;
  // While scenes that were built anew take the place of others, both are open.
  const rlim_t other = kOtherDescriptors + scenes * (2 * files_of_scene + HostedScene::kMaxFetchers);
  const rlim_t left = limit.rlim_cur > 2 * other ? limit.rlim_cur - other : limit.rlim_cur / 2;
  if (left >= wanted) return wanted;
  spdlog::warn("at most {} connections in place of {}: the system allows no more open files (ulimit -n)", left, wanted);
  return static_cast<std::uint32_t>(left);
}

}  // namespace

base::Result<std::unique_ptr<Server>> Server::open(const std::vector<std::string>& scenes,
                                                   const ServerOptions& options) {
  std::unique_ptr<Server> server(new Server);
  // Asio has no constructor that returns its error, where the process may open no more descriptors.
  try {
    server->impl_ = std::make_unique<Impl>(options);
  } catch (const boost::system::system_error& failed) {
    return base::Error{base::ErrorCode::kIo, "cannot wait for connections: " + failed.code().message()};
  }
  Hub& hub = *server->impl_->hub;
  raiseDescriptorLimit();
  const std::size_t before = openDescriptors();
  LUMIGRID_TRY(hub.openScenes(scenes));
  server->impl_->wanted_connections = options.max_connections;
  server->impl_->files_of_scene = (std::max(openDescriptors(), before) - before + scenes.size() - 1) / scenes.size();
  server->impl_->limitConnections();
  LUMIGRID_TRY(server->impl_->listener.checkAddress());
  LUMIGRID_ASSIGN_OR_RETURN(hub.security, Security::read(hub.options, Hub::accessNames(hub.scenes)));
  LUMIGRID_TRY(server->impl_->listener.bind());
  if (options.count_access) hub.startAccessLogs();
  if (options.render_frames) hub.startRenderer();
  return server;
}

std::string placeText(const std::string& address, std::uint16_t port) {
  const bool is_ipv6 = address.find(':') != std::string::npos;
  return (is_ipv6 ? "[" + address + "]" : address) + ":" + std::to_string(port);
}

/// Threads that hang still use all that is here.
Server::~Server() {
  if (!impl_) return;
  impl_->endThreads();
  if (impl_->hangs) std::ignore = impl_.release();
}

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
  impl_->hub->running = true;
  impl_->io.run();
  impl_->signals.reset();  // nobody would hear one from here on, so that it may end the process
  impl_->endThreads();
  return {};
}

bool Server::hangs() const {
  return impl_->hangs;
}

void Server::stop() {
  asio::post(impl_->io, [this] { impl_->shutDown(); });
}

void Server::reload() {
  asio::post(impl_->io, [this] { impl_->reload(); });
}

void Server::onReload(OnReload reload) {
  impl_->on_reload = std::move(reload);
}

ServerMetrics& Server::metrics() {
  return impl_->hub->metrics;
}

base::Result<void> Server::Impl::listenForSignals() {
  signals.emplace(io);
  error_code ec;
  for (const int signal : {SIGINT, SIGTERM, SIGHUP})
    if (!ec) signals->add(signal, ec);
  if (ec) return base::Error{base::ErrorCode::kIo, "cannot listen for SIGINT, SIGTERM and SIGHUP: " + ec.message()};
  waitForSignal();
  return {};
}

void Server::Impl::waitForSignal() {
  signals->async_wait([this](error_code cancelled, int signal) {
    if (cancelled) return;
    waitForSignal();
    onSignal(signal);
  });
}

void Server::Impl::onSignal(int signal) {
  if (signal == SIGHUP) {
    reload();
  } else if (hub->draining || hub->stopping) {
    io.stop();
  } else if (signal == SIGTERM) {
    drain();
  } else {
    shutDown();
  }
}

/// The port stays open, so that whoever watches over the server is told that it stops. A port that is shared is closed,
/// since the system would go on to deal connections to it in place of the processes that stay or come.
void Server::Impl::drain() {
  hub->draining = true;
  if (hub->options.shares_port) listener.close();
  spdlog::info("draining for {:g} s at most: {} connections are open", hub->options.drain_seconds,
               hub->connections.size());
  closeConnections(
      hub->options.drain_seconds, [this] { shutDown(); }, &Connection::closeForDrain);
}

void Server::Impl::reload() {
  if (on_reload.at_once) on_reload.at_once();
  is_reload_wanted = true;
  if (!is_reading) readAgain();
}

/// One reading at a time: where a disk hangs, later reloads are one when it answers.
void Server::Impl::readAgain() {
  is_reading = true;
  is_reload_wanted = false;
  file_reader.submit(0, [this, names = Hub::accessNames(hub->scenes)] {
    auto places = on_reload.read_places ? on_reload.read_places() : std::nullopt;
    auto read = Security::read(hub->options, names);
    asio::post(io, [this, places = std::move(places), read = std::move(read)] { takeUpReload(places, read); });
  });
}

void Server::Impl::takeUpReload(std::optional<Places> places, ReadSecurity read) {
  if (hub->stopping) return;
  is_reading = false;
  if (read) {
    hub->takeSecurity(**read);
    spdlog::info("certificate and tokens are read again");
  } else {
    spdlog::warn("certificate and tokens stay as they were: {}", read.error().message);
  }
  if (!places) {
    places.emplace();
    for (const auto& hosted : hub->scenes) places->push_back(hosted->place);
  }
  wanted_places = std::move(places);
  if (!is_opening) openWanted();
  if (is_reload_wanted) readAgain();
}

/// Scenes are opened by another thread, for one reload after the other; viewers of others notice nothing.
void Server::Impl::openWanted() {
  is_opening = true;
  opener.submit(0, [this, places = *std::exchange(wanted_places, std::nullopt), kept = hub->scenes,
                    wants_renderer = hub->wantsRenderer()] {
    auto opened = std::make_shared<Opened>(Opened{hub->openPlaces(places, kept), nullptr});
    // Scenes that are kept may get another title or light meanwhile, so the io thread gives the renderer its scenes.
    const auto hasPatches = [](const auto& hosted) { return hosted->hasPatches(); };
    if (wants_renderer && opened->scenes && std::any_of(opened->scenes->begin(), opened->scenes->end(), hasPatches))
      opened->renderer = Hub::makeRenderer({});
    asio::post(io, [this, opened] { readNewTokens(opened); });
  });
}

/// Tokens name scenes, so the files are read with the names of those that come.
void Server::Impl::readNewTokens(std::shared_ptr<Opened> opened) {
  const auto names = Hub::accessNames(opened->scenes ? *opened->scenes : hub->scenes);
  file_reader.submit(0, [this, opened, names] {
    auto read = Security::read(hub->options, names);
    asio::post(io, [this, opened, read = std::move(read)] { takeUp(std::move(*opened), read); });
  });
}

void Server::Impl::takeUp(Opened opened, ReadSecurity read) {
  if (hub->stopping) return;
  is_opening = false;
  if (opened.scenes) {
    hub->serveScenes(std::move(*opened.scenes), std::move(opened.renderer));
    limitConnections();
    if (read)
      hub->takeSecurity(**read);
    else
      spdlog::warn("tokens: {}", read.error().message);
    spdlog::info("reloaded: {} scenes", hub->scenes.size());
  } else {
    spdlog::warn("the scenes stay as they were: {}", opened.scenes.error().message);
  }
  if (wanted_places) openWanted();
}

void Server::Impl::limitConnections() {
  hub->options.max_connections = connectionsPossible(wanted_connections, hub->scenes.size(), files_of_scene);
}

void Server::Impl::shutDown() {
  if (hub->stopping) return;
  hub->stopping = true;
  spdlog::info("stopping: {} connections are open", hub->connections.size());
  listener.close();
  constexpr double kCloseSeconds = 2.0;  // for viewers to answer the close frame
  closeConnections(
      kCloseSeconds, [this] { io.stop(); }, &Connection::closeForShutdown);
}

/// Closes all connections; `too_late` is called if some of those to finish are left after so many seconds.
void Server::Impl::closeConnections(double seconds, std::function<void()> too_late, Close close) {
  hub->on_last_connection_closed = [this] { finish(); };
  close_timer.emplace(io, std::chrono::duration_cast<SteadyClock::duration>(std::chrono::duration<double>(seconds)));
  close_timer->async_wait([too_late = std::move(too_late)](error_code cancelled) {
    if (!cancelled) too_late();
  });
  if (hub->connections_to_finish == 0) return finish();
  closeEach(close);
}

void Server::Impl::closeEach(Close close) const {
  // A list that holds them, since closing one may end it at once.
  std::vector<std::shared_ptr<Connection>> open;
  for (Connection* connection : hub->connections) open.push_back(connection->shared_from_this());
  for (const auto& connection : open) ((*connection).*close)();
}

/// Nothing keeps the io thread any more, once the connections that came meanwhile are closed.
void Server::Impl::finish() {
  listener.close();
  closeEach(&Connection::closeForShutdown);
  close_timer.reset();
  error_code ignored;
  if (signals) signals->cancel(ignored);
}

/// Connections that did not close in time are destroyed with `io`, after all else: nothing may wait for them. Nor is a
/// disk waited for that does not answer.
void Server::Impl::endThreads() {
  if (std::exchange(has_ended, true)) return;
  hub->logReadErrors();
  hub->on_last_connection_closed = nullptr;
  close_timer.reset();
  TimedTasks ends;
  ends.add("reading certificate and tokens", [this] { file_reader.stop(); });
  ends.add("opening scenes", [this] { opener.stop(); });
  hub->endThreads(ends);
  std::vector<std::string> late = ends.wait(kEndSeconds);
  TimedTasks logs;
  hub->endAccessLogs(logs);
  for (std::string& name : logs.wait(kAccessSeconds)) late.push_back(std::move(name));
  hangs = !late.empty();
  for (const std::string& name : late) spdlog::warn("a disk does not answer; the server ends without: {}", name);
}

}  // namespace server
