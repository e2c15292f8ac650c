#include "server/metrics/server_metrics.h"

#include "server/metrics/process_metrics.h"

namespace server {
namespace {

constexpr const char* kSentBytes = "lumigrid_sent_bytes_total";
constexpr const char* kSentBytesHelp = "Bytes of groups, faces and frames sent to viewers, and of HTTP answers.";
constexpr const char* kSentItems = "lumigrid_sent_items_total";
constexpr const char* kSentItemsHelp = "Groups, faces and frames sent to viewers.";
constexpr const char* kOpen = "lumigrid_connections_open";
constexpr const char* kOpenHelp = "Connections that are open: requests over HTTP, viewers over WebSocket.";
constexpr const char* kAccepted = "lumigrid_connections_total";
constexpr const char* kAcceptedHelp = "Connections since the start: each begins as http, a viewer's goes on as viewer.";
constexpr const char* kPictures = "lumigrid_pictures_total";
constexpr const char* kPicturesHelp = "Requests for pictures, by how they ended.";
constexpr const char* kLookups = "lumigrid_cache_lookups_total";
constexpr const char* kLookupsHelp = "Look-ups in the server's caches.";
constexpr const char* kQueue = "lumigrid_queue_length";
constexpr const char* kQueueHelp = "Requests that wait for a thread.";

MetricLabels kindOf(const char* kind, const std::string& scene) {
  return {{"kind", kind}, {"scene", scene}};
}

}  // namespace

SceneMetrics::SceneMetrics(Metrics& metrics, const std::string& scene)
    : messages_received(
          metrics.counter("lumigrid_messages_received_total", "Messages of viewers.", {{"scene", scene}})),
      views_received(metrics.counter("lumigrid_views_received_total", "Views that viewers sent.", {{"scene", scene}})),
      views_planned(metrics.counter("lumigrid_views_planned_total", "Views for which was chosen what to send.",
                                    {{"scene", scene}})),
      views_dropped(metrics.counter("lumigrid_views_dropped_total",
                                    "Views that a newer one replaced before they were planned.", {{"scene", scene}})),
      group_bytes(metrics.counter(kSentBytes, kSentBytesHelp, kindOf("group", scene))),
      face_bytes(metrics.counter(kSentBytes, kSentBytesHelp, kindOf("face", scene))),
      frame_bytes(metrics.counter(kSentBytes, kSentBytesHelp, kindOf("frame", scene))),
      groups_sent(metrics.counter(kSentItems, kSentItemsHelp, kindOf("group", scene))),
      faces_sent(metrics.counter(kSentItems, kSentItemsHelp, kindOf("face", scene))),
      frames_sent(metrics.counter(kSentItems, kSentItemsHelp, kindOf("frame", scene))),
      missing(metrics.counter("lumigrid_missing_total", "Wanted faces that the repository lacks.", {{"scene", scene}})),
      damaged(metrics.counter("lumigrid_damaged_total",
                              "Faces and groups that could not be read or whose checksum failed.", {{"scene", scene}})),
      read_errors(metrics.counter("lumigrid_read_errors_total",
                                  "Reads of the scene's files that failed, for viewers, downloads, pictures or picks.",
                                  {{"scene", scene}})),
      plan_seconds(metrics.histogram("lumigrid_plan_seconds", "Time that planning a view takes.", waitingBounds(),
                                     {{"scene", scene}})),
      frame_seconds(metrics.histogram("lumigrid_frame_seconds", "Time from the request of an exact frame to its bytes.",
                                      waitingBounds(), {{"scene", scene}})),
      first_byte_seconds(metrics.histogram("lumigrid_first_byte_seconds",
                                           "Time from a view to the first message that is sent for it.",
                                           waitingBounds(), {{"scene", scene}})) {}

void SessionReporter::report(const SessionTotals& now) {
  metrics_.views_received.add(now.views - reported_.views);
  metrics_.views_planned.add(now.planned - reported_.planned);
  metrics_.views_dropped.add(now.dropped - reported_.dropped);
  metrics_.groups_sent.add(now.groups - reported_.groups);
  metrics_.faces_sent.add(now.faces - reported_.faces);
  metrics_.frames_sent.add(now.frames - reported_.frames);
  metrics_.group_bytes.add(now.group_bytes - reported_.group_bytes);
  metrics_.face_bytes.add(now.face_bytes - reported_.face_bytes);
  metrics_.frame_bytes.add(now.frame_bytes - reported_.frame_bytes);
  metrics_.missing.add(now.missing - reported_.missing);
  metrics_.damaged.add(now.damaged - reported_.damaged);
  reported_ = now;
}

ServerMetrics::ServerMetrics()
    : http_open(all.gauge(kOpen, kOpenHelp, {{"kind", "http"}})),
      viewers_open(all.gauge(kOpen, kOpenHelp, {{"kind", "viewer"}})),
      http_accepted(all.counter(kAccepted, kAcceptedHelp, {{"kind", "http"}})),
      viewers_accepted(all.counter(kAccepted, kAcceptedHelp, {{"kind", "viewer"}})),
      http_bytes(all.counter(kSentBytes, kSentBytesHelp, {{"kind", "http"}})),
      pictures_drawn(all.counter(kPictures, kPicturesHelp, {{"outcome", "drawn"}})),
      pictures_failed(all.counter(kPictures, kPicturesHelp, {{"outcome", "failed"}})),
      pictures_refused(all.counter(kPictures, kPicturesHelp, {{"outcome", "refused"}})) {
  addProcessMetrics(all);
  for (const int status : {0,   200, 204, 206, 301, 302, 303, 304, 400, 401, 403, 404,
                           405, 408, 413, 416, 421, 429, 431, 500, 501, 502, 503})
    answers_[status] = &all.counter("lumigrid_http_answers_total", "HTTP answers by status.",
                                    {{"status", status == 0 ? "other" : std::to_string(status)}});
}

Counter& ServerMetrics::refused(const std::string& reason) {
  return all.counter("lumigrid_refused_total", "Connections, requests and messages that were refused.",
                     {{"reason", reason}});
}

Counter& ServerMetrics::answers(int status) const {
  const auto known = answers_.find(status);
  return *(known == answers_.end() ? answers_.at(0) : known->second);
}

void ServerMetrics::readQueue(const std::string& name, std::function<double()> length) {
  all.read(Metrics::Kind::kGauge, kQueue, kQueueHelp, {{"queue", name}}, std::move(length));
}

void ServerMetrics::readCache(const std::string& name,
                              const std::function<std::pair<std::uint64_t, std::uint64_t>()>& lookups) {
  all.read(Metrics::Kind::kCounter, kLookups, kLookupsHelp, {{"cache", name}, {"outcome", "hit"}},
           [lookups] { return static_cast<double>(lookups().first); });
  all.read(Metrics::Kind::kCounter, kLookups, kLookupsHelp, {{"cache", name}, {"outcome", "miss"}},
           [lookups] { return static_cast<double>(lookups().second); });
}

SceneMetrics& ServerMetrics::scene(const std::string& name) {
  const std::lock_guard lock(mutex_);
  auto& made = scenes_[name];
  if (!made) made = std::make_unique<SceneMetrics>(all, name);
  return *made;
}

}  // namespace server
