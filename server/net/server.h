#pragma once
// One port that speaks WebSocket and HTTP (Boost.Beast). Home of all Asio and Beast code on the server side.
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "server/net/open_scene.h"
#include "server/session/session.h"

namespace server {

struct ServerOptions {
  std::string address = "127.0.0.1";
  std::uint16_t port = 8080;  ///< 0: any free one
  std::uint32_t max_connections = 256;
  /// Per client: bytes that wait in the kernel before the connection counts as full; one message at most waits besides.
  /// Small, so that a new view's data does not queue behind an old one's; large links stay busy, for what is under way
  /// does not count.
  std::uint64_t max_unsent_bytes = 128 * 1024;
  double idle_seconds = 300.0;                       ///< a viewer that answers no ping for so long is dropped
  std::uint64_t ahead_bytes = plan::kPrefetchBytes;  ///< sent to each viewer beyond what its view needs
  bool render_frames = true;                         ///< exact frames, on a thread with its own GL context
  std::string page_directory;  ///< files of the browser client (page_files.h); empty: a plain page at "/"
  /// Of one picture asked for at /render, width times height; 0: none are rendered.
  std::uint64_t max_picture_pixels = 64'000'000;
  std::size_t max_waiting_pictures = 4;  ///< besides the one in hand; further ones are told to come again
  /// How often each face and group was sent is counted and kept (docs/formats/access.md). A place that cannot be
  /// written is warned of, and the scene served all the same.
  bool count_access = true;
  std::string access_file;                ///< empty: SCENE/access.lga
  double access_interval_seconds = 30.0;  ///< between writes; the most that a killed server loses
  RemoteOptions remote;                   ///< for a scene behind a network; `warn` is the server's log
};

/// Serves until stop() (any thread) or until SIGINT/SIGTERM when `handle_signals`.
class Server {
 public:
  /// Opens the scenes, binds the port. One scene is at "/"; of several each is below "/NAME/" (scene_names.h) and "/"
  /// lists them. Errors: not a scene, port in use ("…port 8080 is in use; choose another with --port"), two of one
  /// name. Frames are switched off with a warning in the log when there is no GL context.
  static base::Result<std::unique_ptr<Server>> open(const std::vector<std::string>& scenes,
                                                    const ServerOptions& options);
  ~Server();
  std::uint16_t port() const;
  std::vector<std::string> names() const;  ///< of the scenes, in their order; empty for an only one
  base::Result<void> run(bool handle_signals);
  void stop();

 private:
  Server() = default;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace server
