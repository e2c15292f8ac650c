#pragma once
// A client of a published scene in memory, with a clock of its own.
#include <set>

#include "tests/client/source/memory_host.h"

namespace client {

inline SessionOptions smallOptions() {
  SessionOptions options;
  options.setPatchTolerance(1.0F);
  options.frames = false;
  return options;
}

/// The items that a session was given between two polls.
struct Got {
  std::set<std::uint64_t> faces;
  std::set<std::uint32_t> groups;

  void add(const SessionEvents& events) {
    for (const repository::FaceKey& key : events.faces_added) faces.insert(key.code());
    groups.insert(events.groups_added.begin(), events.groups_added.end());
  }
};

/// A client of a published scene, with a clock of its own.
struct StaticViewer {
  explicit StaticViewer(const PublishedScene& published, const StaticOptions& options = {},
                        const SessionOptions& session_options = smallOptions())
      : host(published), session(session_options), source(published.scene, host, published.readParameters(), options) {}

  bool pump(double seconds = 0.01) {
    now += seconds;
    const bool came = source.pump(session, now);
    got.add(session.takeEvents());
    return came;
  }
  /// Pumps until the view is complete, or nothing happens for long.
  bool complete(const base::ViewCamera& camera) {
    session.setView(camera);
    for (int i = 0; i < 5000; ++i) {
      pump();
      if (session.complete()) return true;
      if (session.phase() == SessionPhase::kRefused) return false;
    }
    return false;
  }
  /// Pumps until data ahead of need have arrived, too.
  void rest() {
    for (int i = 0; i < 1000 && (pump() || host.waiting() != 0); ++i) {
    }
  }

  MemoryHost host;
  Session session;
  StaticSource source;
  Got got;
  double now = 0.0;
};

}  // namespace client
