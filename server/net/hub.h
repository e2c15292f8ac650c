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
#include "server/net/hosted_scene.h"
#include "server/net/security.h"
#include "server/net/server.h"
#include "server/net/unsent_pictures.h"
#include "server/session/fair_queue.h"
#include "server/session/timed_tasks.h"

namespace boost::asio {
class io_context;
}

namespace server {

class Connection;

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
  /// others; their viewers may come back. `drawn_by`: what makeRenderer() made for them, if it was wanted.
  using RendererPointer = std::unique_ptr<FrameRenderer>;
  void serveScenes(Scenes opened, RendererPointer drawn_by = nullptr);
  /// Takes what was read, with the names of the scenes of now.
  void takeSecurity(Security read);
  /// Scenes that are served, and those that are no longer and that somebody holds.
  Scenes allScenes() const;
  /// Draws exact frames and pictures from here on, and of scenes that come later.
  void startRenderer();
  /// Whether a renderer is to be made once there is something to draw.
  bool wantsRenderer() const { return draws_frames && !renderer; }
  /// Waits for the GL, and for the files of the scenes that it prepares, which nobody may change meanwhile; any thread.
  /// Null where there is no GL context, and the log says why.
  static RendererPointer makeRenderer(const std::vector<FrameRenderer::ScenePointer>& prepared);
  /// Counts what is sent, from here on and in scenes that come later, if the options ask for it.
  void startAccessLogs();
  /// The scene that a request addresses, and in `rest` what is asked of it; null for an unknown scene and for the list.
  /// A scene is below its name. That at `root_place` is below "/", too, but for what others are called.
  std::shared_ptr<HostedScene> findScene(const RequestHead& request, std::string_view& rest) const;
  /// The answer to a request that is about the server: /healthz, /readyz and /metrics, with one scene or several. For
  /// the io thread, as what is measured includes what is its alone. What is measured tells of all scenes, so it is for
  /// those who may see them all.
  std::optional<HttpReply> answerForServer(const HttpRequest& request, const RequestHead& head) const;
  /// Names of scenes as tokens and links have them, once they are served.
  static std::vector<std::string> accessNames(const Scenes& scenes);
  /// As Security::answerInstead, for the scene that findScene() found.
  std::optional<HttpReply> answerInstead(const RequestHead& request, const HostedScene* hosted) const;
  /// The answer to a request that addresses none of several scenes. The list has those that the visitor may see.
  HttpReply answerForAllScenes(const HttpRequest& request, const RequestHead& head) const;
  /// Begins to end workers, fetchers, renderer and pickers, whose threads post to `io`; so this precedes the end of
  /// `io`. Each of them may wait for a disk.
  void endThreads(TimedTasks& ends);
  void takeRenderer(RendererPointer made);
  void offerFrames(const HostedScene& hosted);
  void endScene(const std::shared_ptr<HostedScene>& hosted);
  /// Tells the log how many reads of each scene failed.
  void logReadErrors() const;
  /// Begins to write the access counts of all scenes; what is sent from here on is not counted.
  void endAccessLogs(TimedTasks& ends) const;

  /// Whether new visitors are welcome.
  bool isReady() const { return running && !draining && !stopping; }

  boost::asio::io_context& io;
  ServerOptions options;
  ServerMetrics metrics;                                                             ///< before all that updates it
  std::shared_ptr<LookupCounts> message_lookups = std::make_shared<LookupCounts>();  ///< of all scenes since the start
  std::shared_ptr<HeldMemory> held;                                                  ///< of all viewers; not null
  std::shared_ptr<FairQueue> disposer = std::make_shared<FairQueue>(1);  ///< ends scenes that nobody holds any more
  Scenes scenes;                                                         ///< at least one
  /// The place of the only scene, or of the one that was when others came: its pages that are open go on. Empty:
  /// several were served from the start, or it is no longer served.
  std::string root_place;
  std::vector<std::weak_ptr<HostedScene>> ended_scenes;  ///< those that connections may still hold
  PageFiles pages;                                       ///< of the browser client
  std::shared_ptr<const Security> security;              ///< not null while the port is bound
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
