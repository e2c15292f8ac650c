#pragma once
// The scenes of a server, and the state that all its connections share.
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "server/metrics/server_metrics.h"
#include "server/net/frame_renderer.h"
#include "server/net/pick.h"
#include "server/net/security.h"
#include "server/net/server.h"
#include "server/net/site.h"
#include "server/net/unsent_pictures.h"
#include "server/scene/access_log.h"
#include "server/scene/open_scene.h"
#include "server/session/fair_queue.h"

namespace boost::asio {
class io_context;
}

namespace server {

class Connection;

/// One scene of a server with everything that answers for it.
struct HostedScene {
  HostedScene(std::string from, std::shared_ptr<OpenScene> opened)
      : place(std::move(from)), scene(std::move(opened)), fetchers(makeFetchers(*scene)) {}

  std::string place;        ///< where it was opened
  std::string name;         ///< first part of its addresses; empty for an only scene, which is at "/", too
  std::string access_name;  ///< the same of an only scene, too, and its name in tokens and signed links
  std::shared_ptr<OpenScene> scene;
  std::unique_ptr<Site> site;
  std::unique_ptr<Picker> picker;     ///< null: the scene has no patches
  std::unique_ptr<AccessLog> access;  ///< null: nothing is counted
  /// Wait for the scene's disk or network, each of which may stall without delaying other scenes. The last member: what
  /// its jobs use outlives them.
  std::unique_ptr<FairQueue> fetchers;

  static constexpr unsigned kMaxFetchers = 8;  ///< each has a file or a connection of its own while it reads
  bool hasPatches() const { return scene->data.patches != nullptr; }
  /// Starts to count what is sent, in the file that the options name or in the scene's directory. A scene without
  /// patches has nothing to count; where the counts would have no place, the log says so.
  void startAccessLog(const ServerOptions& options, const std::string& scene_directory);

 private:
  static std::unique_ptr<FairQueue> makeFetchers(const OpenScene& scene);
};

/// Only the io thread uses it, with these exceptions: fetchers read `stopping`, and queues and renderer have their own
/// locks.
struct Hub {
  Hub(boost::asio::io_context& context, ServerOptions chosen);

  /// Opens the scenes at these places and serves them. Errors: as Server::open, but for those of the port.
  base::Result<void> openScenes(const std::vector<std::string>& places);
  using Scenes = std::vector<std::shared_ptr<HostedScene>>;
  /// Opens the scene at one of so many places.
  base::Result<std::shared_ptr<HostedScene>> openPlace(const std::string& place, std::size_t scenes) const;
  /// Opens those of the places that are none of `kept`, or where another scene lies by now; the others are taken from
  /// `kept`. Uses nothing that changes while the server runs, so that another thread may call it. Errors as
  /// openScenes().
  base::Result<Scenes> openPlaces(const std::vector<std::string>& places, const Scenes& kept) const;
  /// Serves these scenes, as openPlaces() returned them for the places, from here on, and closes the connections to
  /// others; their viewers may come back.
  void serveScenes(Scenes opened);
  /// Starts the renderer for exact frames and pictures. Without a GL context the log says why there are none.
  void startRenderer();
  /// Counts what is sent, from here on and in scenes that come later, if the options ask for it.
  void startAccessLogs();
  /// The scene that a request addresses, and in `rest` what is asked of it; null for an unknown scene and for the list.
  /// A scene is below its name. That at `root_place` is below "/", too, but for what others are called.
  std::shared_ptr<HostedScene> findScene(const RequestHead& request, std::string_view& rest) const;
  /// The answer to a request that is about the server: /healthz, /readyz and /metrics, with one scene or several. For
  /// the io thread, as what is measured includes what is its alone. What is measured tells of all scenes, so it is for
  /// those who may see them all.
  std::optional<HttpReply> answerForServer(const HttpRequest& request, const RequestHead& head) const;
  /// Reads the files on who may see the scenes, and the certificate. Call it after openScenes(), and again when they
  /// changed: what is wrong then leaves all as it was.
  base::Result<void> readSecurity();
  /// As Security::answerInstead, for the scene that findScene() found.
  std::optional<HttpReply> answerInstead(const RequestHead& request, const HostedScene* hosted) const;
  /// The answer to a request that addresses none of several scenes. The list has those that the visitor may see.
  HttpReply answerForAllScenes(const HttpRequest& request, const RequestHead& head) const;
  /// Ends workers, fetchers, renderer and pickers, whose threads post to `io`; so this precedes the end of `io`.
  void endThreads();
  void offerFrames(const HostedScene& hosted);
  void endScene(const std::shared_ptr<HostedScene>& hosted);
  /// Tells the log how many reads of each scene failed.
  void logReadErrors() const;
  /// Writes the access counts of all scenes; nothing is counted from here on.
  void endAccessLogs();

  /// Whether new visitors are welcome.
  bool isReady() const { return running && !draining && !stopping; }

  boost::asio::io_context& io;
  ServerOptions options;
  ServerMetrics metrics;                                                             ///< before all that updates it
  std::shared_ptr<LookupCounts> message_lookups = std::make_shared<LookupCounts>();  ///< of all scenes since the start
  std::shared_ptr<FairQueue> disposer = std::make_shared<FairQueue>(1);  ///< ends scenes that nobody holds any more
  Scenes scenes;                                                         ///< at least one
  /// The place of the only scene, or of the one that was when others came: its pages that are open go on. Empty:
  /// several were served from the start, or it is no longer served.
  std::string root_place;
  std::vector<std::weak_ptr<HostedScene>> ended_scenes;  ///< those that connections may still hold
  PageFiles pages;                                       ///< of the browser client
  std::shared_ptr<const Security> security;              ///< after readSecurity()
  std::unique_ptr<FrameRenderer> renderer;               ///< null: no exact frames
  FairQueue workers;                                     ///< plan for viewers and make their messages
  std::string place;                                     ///< address:port
  std::set<Connection*> connections;
  std::map<std::string, std::uint32_t> connections_of;  ///< their number, by limitKey() of the client's address
  std::map<std::string, std::uint32_t> turned_away_of;  ///< likewise, of connections that get nothing but a refusal
  std::size_t connections_to_finish = 0;                ///< those that did not come while the server drained
  std::function<void()> on_last_connection_closed;      ///< of those to finish; set while the server drains or stops
  std::uint64_t next_client = 1;
  std::size_t viewers = 0;
  UnsentPictures unsent_pictures;
  bool counts_access = false;
  bool draws_frames = false;
  std::atomic<bool> running = false;
  std::atomic<bool> draining = false;  ///< only health is told to new requests, and no connection is kept for another
  std::atomic<bool> stopping = false;
};

/// Connections over ServerOptions::max_connections that are still accepted, to be answered with a 503; and those of one
/// address, so that no other one is kept from asking for the server's health. Choices: each holds a descriptor for a
/// moment.
inline constexpr std::uint32_t kMaxTurnedAway = 64, kMaxTurnedAwayOfAddress = kMaxTurnedAway / 4;

}  // namespace server
