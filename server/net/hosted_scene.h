#pragma once
// One scene of a server with everything that answers for it.
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "server/net/pick.h"
#include "server/net/site.h"
#include "server/scene/access_log.h"
#include "server/scene/open_scene.h"
#include "server/session/fair_queue.h"

namespace boost::asio {
class io_context;
}

namespace server {

struct ServerOptions;

/// For the io thread, but for its making and its end.
class HostedScene : public std::enable_shared_from_this<HostedScene> {
 public:
  HostedScene(boost::asio::io_context& io, std::string from, std::shared_ptr<OpenScene> opened, PageFiles pages);
  ~HostedScene();
  HostedScene(const HostedScene&) = delete;
  HostedScene& operator=(const HostedScene&) = delete;

  bool hasPatches() const { return scene->data.patches != nullptr; }
  /// Starts to count what is sent, in the file that the options name or in the scene's directory. A scene without
  /// patches has nothing to count; where the counts would have no place, the log says so.
  void startAccessLog(const ServerOptions& options);
  /// Calls `then`, on the io thread, once the site has taken up what the scene's documents were at this call or later.
  /// A disk that does not answer for kPatienceSeconds, or has not for as long, is not waited for: the site goes on with
  /// what it has.
  void whenFresh(std::function<void()> then);
  static constexpr double kPatienceSeconds = 5.0;  ///< far above the time of a disk that spins up; a choice

  const std::string place;        ///< where it was opened
  const std::string access_name;  ///< its name in addresses, tokens and signed links; a single scene may have none
  /// Tells the scene's viewers from those of others where they share threads (FairQueue::setGroup).
  const std::uint64_t group;
  std::string name;  ///< the same while there are others, and empty for an only scene, which is at "/", too
  const std::shared_ptr<OpenScene> scene;
  const std::unique_ptr<Site> site;
  std::unique_ptr<Picker> picker;     ///< null: the scene has no patches
  std::unique_ptr<AccessLog> access;  ///< null: nothing is counted

 private:
  void readDocuments();
  void takeUp(ChangedDocuments changed);
  void stopWaiting();

  struct Patience;  // a timer
  const std::unique_ptr<Patience> patience_;
  std::vector<std::function<void()>> waiting_;  // for the documents that are being read
  std::vector<std::function<void()>> next_;     // for those that will be read after them
  bool is_reading_ = false;
  bool hangs_ = false;  // it was given up to wait for them

 public:
  /// Wait for the scene's disk or network, each of which may stall without delaying other scenes. The last member: what
  /// its jobs use outlives them.
  const std::unique_ptr<FairQueue> fetchers;
  static constexpr unsigned kMaxFetchers = 8;  ///< each has a file or a connection of its own while it reads
};

}  // namespace server
