#pragma once
// Serves scenes on one port, over WebSocket and HTTP. Asio and Beast are used in this folder only.
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "server/auth/access_rules.h"
#include "server/metrics/server_metrics.h"
#include "server/net/frame_renderer.h"
#include "server/scene/open_scene.h"
#include "server/session/session.h"

namespace server {

struct ServerOptions {
  std::string address = "127.0.0.1";
  std::uint16_t port = 8080;               ///< 0: any free one
  bool shares_port = false;                ///< with other processes of this user (SO_REUSEPORT)
  AccessOptions access;                    ///< who may see the scenes; the default is enough for a loopback address
  std::string certificate_file, key_file;  ///< PEM, for TLS; both empty: plain TCP
  std::uint32_t max_connections = 1024;    ///< fewer where the system allows fewer open files
  std::uint32_t connections_per_address = 256;  ///< of them
  /// Bytes per client that wait in the kernel before the connection counts as full; at most one more message waits in
  /// the session. The limit is small, so that a new view's data does not queue behind an old one's. Fast links stay
  /// busy all the same, since bytes under way do not count.
  std::uint64_t max_unsent_bytes = 128 * 1024;
  /// A visitor over HTTP has `stall_seconds` for each megabyte of an answer, and a second more for so many bytes of it.
  double min_bytes_per_second = 16.0 * 1024.0;
  double head_seconds = 10.0;                 ///< for the head of a connection's first request
  double hello_seconds = 10.0;                ///< for a viewer's first message
  double stall_seconds = 30.0;                ///< a viewer that takes no byte of what waits for so long is dropped
  double idle_seconds = 3600.0;               ///< one that sends no message for so long likewise
  double messages_per_second = 120.0;         ///< of a viewer that are read; others wait on its side
  double views_per_second = kViewsPerSecond;  ///< of a moving viewer that are planned for while others wait
  std::uint64_t held_bytes = HeldMemory::kDefaultBytes;  ///< of what is remembered of the images that viewers hold
  std::uint64_t ahead_bytes = plan::kPrefetchBytes;      ///< sent to each viewer beyond what its view needs
  std::uint64_t message_cache_bytes = std::uint64_t{256} << 20;  ///< of what several viewers get, in all scenes
  bool render_frames = true;                                     ///< exact frames, on a thread with its own GL context
  std::string page_directory;  ///< files of the browser client (page_files.h); empty: a plain page at "/"
  std::uint64_t max_picture_pixels = 64'000'000;  ///< width times height of one picture of /render; 0: none
  PictureLimits picture_limits;                   ///< further pictures are answered with a 503
  /// Whether to count how often each face and group is sent, and keep the counts (docs/formats/access.md). If the file
  /// cannot be written, the log says so, and the scene is served all the same.
  bool count_access = true;
  std::string access_file;                ///< empty: SCENE/access.lga
  double access_interval_seconds = 30.0;  ///< between writes; a killed server loses at most so much
  RemoteOptions remote;                   ///< for remote scenes; `warn` is replaced by the server's log
  double drain_seconds = 30.0;            ///< after SIGTERM, for answers that are under way
};

/// "address:port" as it stands in an address of the web: IPv6 in brackets.
std::string placeText(const std::string& address, std::uint16_t port);

/// Serves until stop() (any thread) or until a signal when `handle_signals`. SIGINT is stop(). SIGTERM sends viewers
/// away to connect elsewhere, and lets answers under way be finished within `drain_seconds`; new requests are told to
/// come again later, but for those about the server's health, or the port is closed where it is shared. A further
/// SIGTERM or SIGINT ends that at once. SIGHUP is reload().
class Server {
 public:
  /// Opens the scenes and binds the port. Each scene is below "/NAME/" (scene_names.h), an only one at "/", too; else
  /// "/" lists them. Errors: not a scene, a port in use, two scenes of one name. Without a GL context there are no
  /// exact frames, and the log says so.
  static base::Result<std::unique_ptr<Server>> open(const std::vector<std::string>& scenes,
                                                    const ServerOptions& options);
  ~Server();
  std::uint16_t port() const;
  std::vector<std::string> names() const;  ///< names of the scenes, in their order; a single scene's name is empty
  base::Result<void> run(bool handle_signals);
  /// Whether threads were left behind at the end of run(), as a disk does not answer them. What they use is left behind
  /// with them, so the process is to end by _Exit(), which waits for nothing.
  bool hangs() const;
  /// Tells viewers that the server stops, and ends within two seconds. Any thread.
  void stop();
  /// Calls what onReload() was given and reads certificate, key, tokens and signing keys again, for connections from
  /// then on. Then scenes that are new or were built anew are opened while others are served on, and viewers of those
  /// that were replaced or removed are told to connect again. Where a file is wrong, the log says so, and all stays as
  /// it was. Any thread; SIGHUP does it, too.
  void reload();
  struct OnReload {
    std::function<void()> at_once;  ///< must not wait for a disk
    /// Reads, on a thread that may wait for a disk, the places of the scenes to serve from then on; nothing: those that
    /// are served.
    std::function<std::optional<std::vector<std::string>>()> read_places;
  };
  /// To be called before run().
  void onReload(OnReload reload);
  ServerMetrics& metrics();

 private:
  Server() = default;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace server
