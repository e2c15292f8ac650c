#pragma once
// The thin client's session is a state machine with bytes in and bytes out. It has no socket, no GL and no clock of its
// own, so that tests need no network and every platform shares it.
//
// Phases: connected() leads from kDisconnected to kGreeting, a Welcome from there to kReady; disconnected() leads back
// to kDisconnected and keeps all data; a Refusal leads to kRefused. The cache survives a reconnect: once the new
// Welcome shows that the scene is the same, the session tells the server what it holds (docs/formats/protocol.md,
// "Holdings") before its first View. A Welcome that describes another scene drops everything.
//
// The session sends, in this order: Hello; after Welcome its Holdings; then, when the view changed, what was evicted
// since and the newest View. Evictions wait for a View on purpose: a server that hears of one while the view stands
// still would send the same bytes again, and with a cache smaller than the view's needs the two would never stop.
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/view_defaults.h"
#include "client/source/method.h"
#include "lod/patch/traverse.h"
#include "protocol/message.h"

namespace client {

enum class SessionPhase { kDisconnected, kGreeting, kReady, kRefused };

struct SessionOptions {
  std::uint64_t cache_bytes = 50'000'000;  ///< compressed faces and patches, LRU (Okamoto 2011, section 6: 50 MB)
  std::uint64_t frame_bytes =
      16'000'000;  ///< exact frames kept in coded form, the newest first; a frame larger than this is dropped
  bool images = true;
  bool frames = true;
  float patch_tolerance_px = base::ViewDefaults::kPatchTolerance;
  std::uint32_t max_triangles = base::ViewDefaults::kMaxTriangles;
  std::uint16_t max_points = base::ViewDefaults::kPoints;
};

struct SessionStats {
  std::uint64_t bytes_received = 0, bytes_faces = 0, bytes_patches = 0, bytes_frames = 0;
  std::uint64_t messages_received = 0, faces_received = 0, groups_received = 0, frames_received = 0;
  std::uint64_t views_sent = 0;
  std::uint64_t cache_bytes = 0;  ///< compressed faces and patches held
  std::uint64_t frame_bytes = 0;  ///< exact frames held
};

/// Changes since the last call to takeEvents(), from which the renderer decides what to decode, upload or drop.
struct SessionEvents {
  bool welcomed = false;  ///< the first Welcome arrived, or one of another scene: everything known before is void
  std::vector<repository::FaceKey> faces_added, faces_evicted;
  std::vector<std::uint32_t> groups_added, groups_evicted;
  std::vector<std::uint32_t> frames_added;  ///< view sequences
};

class Session {
 public:
  explicit Session(const SessionOptions& options);
  ~Session();
  Session(Session&& other) noexcept;
  Session& operator=(Session&& other) noexcept;

  // These are called by the transport.
  void connected();
  void disconnected(const std::string& reason);
  /// Ends the session as a Refusal does, with these very words as the problem, since another try is of no use.
  /// `method_instead`: the method that this scene has data for.
  void refuse(const std::string& reason, std::optional<Method> method_instead = std::nullopt);
  /// Takes in one message. An error says what the server did wrong; the caller then closes the connection.
  base::Result<void> receive(base::ByteView message);
  /// Returns the next message to send, or nullopt.
  std::optional<base::Bytes> nextToSend();

  // These are called by the viewer.
  void setView(const base::ViewCamera& camera);
  /// Switches images and exact frames on or off from the next view on, which is sent again when this changes something.
  void setWanted(bool images, bool frames);
  SessionPhase phase() const;
  const std::string& problem() const;  ///< the reason when disconnected or refused; empty when all is well
  /// After a refusal: the method of a viewer that would not be refused, because the scene is splats-only, or has no
  /// splats.
  std::optional<Method> methodInstead() const;
  const protocol::Welcome* welcome() const;  ///< null before the first Welcome
  /// Whether the server sent everything for the newest view and, where an exact frame was requested, that frame arrived
  /// too.
  bool complete() const;
  SessionEvents takeEvents();

  /// Returns the cached bytes of a face or of a group's block, null when they are not cached. Both count as a use in
  /// the LRU order.
  const base::Bytes* face(const repository::FaceKey& key);
  const base::Bytes* block(std::uint32_t group);
  const protocol::Frame* frame(
      std::uint32_t sequence) const;  ///< one of the 4 newest that fit into frame_bytes, else null
  /// Names what the current picture consists of. It is never evicted until the next call names something else, and
  /// counts as the most recently used.
  void setInUse(const std::vector<repository::FaceKey>& faces, const std::vector<std::uint32_t>& groups);
  const lod::patch::Hierarchy& hierarchy() const;
  bool hasGroup(std::uint32_t group) const;  ///< whether the group's block is cached
  const SessionStats& stats() const;
  const SessionOptions& options() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace client
