#pragma once
// What feeds a session: a WebSocket to a server, or a published scene read by ranges. Nothing here makes the render
// loop wait.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "client/source/ray_picks.h"
#include "client/source/session.h"
#include "client/source/splat_view.h"

namespace client {

/// A link to emulate on the receiving side; zeros: as fast as it comes.
struct LinkLimit {
  double bytes_per_second = 0.0;
  double latency_seconds = 0.0;  ///< added to each message on its way here, so once per round trip
};

/// The delivery times of a link with a given rate and latency: one message after the other, then the way here.
class LinkClock {
 public:
  using Clock = std::chrono::steady_clock;
  static Clock::duration toDuration(double seconds) {
    return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  }

  void setLimit(const LinkLimit& limit) { limit_ = limit; }
  bool limited() const { return limit_.bytes_per_second > 0.0 || limit_.latency_seconds > 0.0; }
  /// When the last byte of a message that is here now would have left the link.
  Clock::time_point pass(std::size_t bytes, Clock::time_point now) {
    free_ = std::max(free_, now);
    if (limit_.bytes_per_second > 0.0) free_ += toDuration(static_cast<double>(bytes) / limit_.bytes_per_second);
    return free_;
  }
  Clock::time_point due() const { return free_ + toDuration(limit_.latency_seconds); }

 private:
  LinkLimit limit_;
  Clock::time_point free_{};
};

/// What was asked of a host and came.
struct LinkCounts {
  std::uint64_t requests = 0;
  std::uint64_t bytes = 0;  ///< bodies, tables and index among them
};

class Link {
 public:
  virtual ~Link() = default;
  /// Hands all that arrived to the session and takes what it wants to send. Never waits. True when something arrived.
  /// From the thread that owns the session.
  virtual bool pump(Session& session) = 0;
  /// Waits until pump() would find something, at most `seconds`. For callers that have nothing to draw.
  virtual void waitForArrival(double seconds) = 0;
  /// Looks for the full-resolution surface on a ray (StaticSource::pick). False: it cannot; a server has /pick for
  /// that.
  virtual bool pick(std::uint32_t /*id*/, const glm::dvec3& /*origin*/, const glm::dvec3& /*direction*/) {
    return false;
  }
  virtual std::vector<AnsweredPick> takePicks() { return {}; }
  /// Of a link that was opened for splats, once it knows of them: for Viewer::setSplats(). Null before, and else.
  virtual std::shared_ptr<SplatView> splats() const { return nullptr; }
  /// Since it began. Nothing where there is one connection, which the session counts.
  virtual LinkCounts counts() const { return {}; }
};

/// By the address: "https://…", an "http://…" that has a folder or ends in "scene.json" is a published scene; all else
/// a server, as parseServerUrl says.
bool isPublishedScene(const std::string& url);
/// Whether openLink() would take it. Errors say what is wrong with the text.
base::Result<void> checkUrl(const std::string& url);
/// Starts at once.
base::Result<std::unique_ptr<Link>> openLink(const std::string& url, const LinkLimit& limit = {});
/// The same for Method::kQsplat: scene.json and qsplat.lgq by HTTP, from a server of ours as from any other host.
base::Result<std::unique_ptr<Link>> openSplatLink(const std::string& url, const LinkLimit& limit,
                                                  const SplatOptions& options);

}  // namespace client
