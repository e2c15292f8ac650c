#pragma once
// The metrics of a server by their names (docs/formats/metrics.md). Whoever updates one holds a reference to it; the
// look-up by name happens once.
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "server/metrics/metrics.h"

namespace server {

/// The metrics of one scene's viewers; each has the label "scene".
struct SceneMetrics {
  SceneMetrics(Metrics& metrics, const std::string& scene);

  Counter& messages_received;
  Counter &views_received, &views_planned, &views_dropped;
  Counter &group_bytes, &face_bytes, &frame_bytes;  ///< without the messages' headers
  Counter &groups_sent, &faces_sent, &frames_sent;
  Counter& missing;               ///< faces that the store lacks
  Counter& damaged;               ///< faces and blocks of groups whose checksum failed
  Counter& read_errors;           ///< of all that reads the scene's files
  Histogram& plan_seconds;        ///< planning of one view, on its worker
  Histogram& frame_seconds;       ///< from the request of an exact frame to its bytes
  Histogram& first_byte_seconds;  ///< from a view to the first message for it that is handed to the kernel
};

/// Numbers of one session as they are now; they only grow.
struct SessionTotals {
  std::uint64_t views = 0, planned = 0, dropped = 0;
  std::uint64_t groups = 0, faces = 0, frames = 0;
  std::uint64_t group_bytes = 0, face_bytes = 0, frame_bytes = 0;
  std::uint64_t missing = 0, damaged = 0;
};

/// Adds what a session's numbers grew by to its scene's.
class SessionReporter {
 public:
  explicit SessionReporter(SceneMetrics& metrics) : metrics_(metrics) {}
  void report(const SessionTotals& now);

 private:
  SceneMetrics& metrics_;
  SessionTotals reported_;
};

class ServerMetrics {
 public:
  ServerMetrics();

  Metrics all;
  Gauge &http_open, &viewers_open;
  Counter &http_accepted, &viewers_accepted;
  Counter& http_bytes;  ///< of answers, with their heads
  Counter &pictures_drawn, &pictures_failed, &pictures_refused;

  /// Connections, requests and messages that were refused; `reason`: one of a few words of the code's own, such as
  /// "connections", "address", "rate", "timeout", "protocol", "origin", "token".
  Counter& refused(const std::string& reason);
  /// Answers with this status.
  Counter& answers(int status) const;
  /// Asks for the length of a queue, and for the hits and misses of a cache, whenever the text is made.
  void readQueue(const std::string& name, std::function<double()> length);
  void readCache(const std::string& name, const std::function<std::pair<std::uint64_t, std::uint64_t>()>& lookups);
  SceneMetrics& scene(const std::string& name);

 private:
  std::map<int, Counter*> answers_;  // not changed after the start; 0: any other status
  std::mutex mutex_;
  std::map<std::string, std::unique_ptr<SceneMetrics>> scenes_;
};

}  // namespace server
