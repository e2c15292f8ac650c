#pragma once
// A link feeds a session: from a WebSocket to a server, or from a published scene read by ranges. Nothing here makes
// the render loop wait.
#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "base/error.h"
#include "client/native/host_access.h"
#include "client/source/ray_picks.h"
#include "client/source/session.h"
#include "client/source/streamed_view.h"

namespace client {

/// A link to emulate on the receiving side; zeros mean as fast as data arrive.
struct LinkLimit {
  double bytes_per_second = 0.0;
  double latency_seconds = 0.0;  ///< added to each message towards the client, so once per round trip
};

/// Computes when messages are delivered over a link with a given rate and latency: one message after the other, then
/// the latency.
class LinkClock {
 public:
  using Clock = std::chrono::steady_clock;
  static Clock::duration toDuration(double seconds) {
    return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  }

  void setLimit(const LinkLimit& limit) { limit_ = limit; }
  bool limited() const { return limit_.bytes_per_second > 0.0 || limit_.latency_seconds > 0.0; }
  /// Sends a message that is here now over the link, and returns when its last byte leaves the link.
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

/// Waits until the first delivery of a queue is due, at most `seconds`. `lock` guards the queue, whose entries have a
/// `due`; `arrived` is notified of new ones.
template <class Queue>
void waitForDelivery(std::unique_lock<std::mutex>& lock, std::condition_variable& arrived, const Queue& queue,
                     double seconds) {
  using Clock = LinkClock::Clock;
  const Clock::time_point until = Clock::now() + LinkClock::toDuration(seconds);
  while (Clock::now() < until) {
    if (queue.empty()) {
      arrived.wait_until(lock, until);
      continue;
    }
    const Clock::time_point due = queue.front().due;
    if (due <= Clock::now()) return;
    arrived.wait_until(lock, std::min(due, until));
  }
}

/// Counts of a link over HTTP.
struct LinkCounts {
  std::uint64_t requests = 0;
  std::uint64_t bytes = 0;  ///< bytes of bodies, tables and index included
};

class Link {
 public:
  virtual ~Link() = default;
  /// Hands everything that arrived to the session and sends its messages. Never waits. Returns true when something
  /// arrived. Called from the thread that owns the session.
  virtual bool pump(Session& session) = 0;
  /// Waits until pump() would find something, at most `seconds`. For callers that have nothing to draw.
  virtual void waitForArrival(double seconds) = 0;
  /// Starts to look for the full-resolution surface on a ray (StaticSource::pick). Returns false when this link cannot;
  /// a server answers /pick instead.
  virtual bool pick(std::uint32_t /*id*/, const glm::dvec3& /*origin*/, const glm::dvec3& /*direction*/) {
    return false;
  }
  virtual std::vector<AnsweredPick> takePicks() { return {}; }
  /// The view of a link that was opened for a streamed method, for Viewer::setStreamed(). Null until the link has it,
  /// and for other links.
  virtual std::shared_ptr<StreamedView> streamed() const { return nullptr; }
  /// Counts since the link was opened; zeros with a server, whose messages the session counts.
  virtual LinkCounts counts() const { return {}; }
};

/// Whether an address names a published scene: "https://…", or an "http://…" that has a folder or ends in "scene.json".
/// All others are servers, as for parseServerUrl.
bool isPublishedScene(const std::string& url);
/// Checks whether openLink() accepts the address. Errors say what is wrong with the text.
base::Result<void> checkUrl(const std::string& url);
/// Opens a link, which starts to connect at once. A scene on this machine (localSceneDirectory) has no link to limit.
base::Result<std::unique_ptr<Link>> openLink(const std::string& url, const LinkLimit& limit = {},
                                             const HostAccess& access = {});
/// Opens a link for a method for which isStreamed(): scene.json and the method's file over HTTP, from a server of ours
/// or any other host, or from a folder on this machine.
base::Result<std::unique_ptr<Link>> openStreamedLink(const std::string& url, Method method, const LinkLimit& limit,
                                                     const StreamedOptions& options, const HostAccess& access = {});

}  // namespace client
