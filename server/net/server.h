#pragma once
// One port that speaks WebSocket and HTTP (Boost.Beast). Home of all Asio and Beast code on the server side.
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "server/session/session.h"

namespace server {

struct ServerOptions {
  std::string address = "127.0.0.1";
  std::uint16_t port = 8080;            ///< 0: any free one
  std::uint32_t max_connections = 256;
  std::uint64_t max_unsent_bytes = 1 << 20;  ///< per client
  double idle_seconds = 300.0;
  bool render_frames = true;            ///< exact frames, on a thread with its own GL context
};

/// Serves until stop() (any thread) or until SIGINT/SIGTERM when `handle_signals`.
class Server {
 public:
  /// Opens the scene, binds the port. Errors: not a scene, port in use ("…port 8080 is in use; choose another with --port").
  static base::Result<std::unique_ptr<Server>> open(const std::string& scene_directory, const ServerOptions& options);
  ~Server();
  std::uint16_t port() const;
  base::Result<void> run(bool handle_signals);
  void stop();

 private:
  Server() = default;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace server
