#pragma once
// The thin client's session: a state machine with bytes in and bytes out; no socket, no GL, no clock of its own (DESIGN
// section 7).
//
// States: kDisconnected → (connected()) kGreeting → (Welcome) kReady; (disconnected()) → kDisconnected, keeping all
// data; (Refusal) → kRefused. What is cached survives a reconnect: once the new Welcome shows that the scene is the
// same one, the session tells what it holds (protocol.md, "Holdings") before its first View. A Welcome that describes
// another scene drops everything.
//
// What goes out, in order: Hello; after Welcome Holdings; then, when the view changed, what was evicted since and the
// newest View. Evictions wait for a View on purpose: a server that hears of one while the view stands still would send
// the same bytes again, and with a cache smaller than the view's needs the two would go on for ever.
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "client/source/method.h"
#include "lod/patch/traverse.h"
#include "protocol/message.h"

namespace client {

enum class SessionPhase { kDisconnected, kGreeting, kReady, kRefused };

struct SessionOptions {
  std::uint64_t cache_bytes = 50'000'000;  ///< compressed faces and patches, LRU (Okamoto 2011, section 6: 50 MB)
  std::uint64_t frame_bytes =
      16'000'000;  ///< exact frames kept as they came, the newest first; larger ones are dropped
  bool images = true;
  bool frames = true;
  float patch_tolerance_px = 4.0F;
  std::uint32_t max_triangles = 300'000;
  std::uint16_t max_points = 8;
};

struct SessionStats {
  std::uint64_t bytes_received = 0, bytes_faces = 0, bytes_patches = 0, bytes_frames = 0;
  std::uint64_t messages_received = 0, faces_received = 0, groups_received = 0, frames_received = 0;
  std::uint64_t views_sent = 0;
  std::uint64_t cache_bytes = 0;  ///< compressed faces and patches held
  std::uint64_t frame_bytes = 0;  ///< exact frames held
};

/// What changed since the last call to takeEvents(): the renderer's cue to decode, upload or drop.
struct SessionEvents {
  bool welcomed = false;  ///< the first Welcome, or one of another scene: forget all that was there before
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

  // Transport side.
  void connected();
  void disconnected(const std::string& reason);
  /// There is no use in trying again: as a Refusal, with these very words as the problem. `instead`: the method that
  /// this scene has data for.
  void refuse(const std::string& reason, std::optional<Method> method_instead = std::nullopt);
  /// An error says what the server did wrong; the caller closes the connection.
  base::Result<void> receive(base::ByteView message);
  /// The next message to send, or nullopt.
  std::optional<base::Bytes> nextToSend();

  // Viewer side.
  void setView(const base::ViewCamera& camera);
  /// From the next view on, which is sent again when this changes something.
  void setWanted(bool images, bool frames);
  SessionPhase phase() const;
  const std::string& problem() const;  ///< why disconnected or refused; empty when all is well
  /// Of a refusal: a viewer of this method is not refused. The scene has splats alone, or none.
  std::optional<Method> methodInstead() const;
  const protocol::Welcome* welcome() const;  ///< null before the first Welcome
  /// The server said that everything for the newest view was sent and, where an exact frame was asked for, that came
  /// too.
  bool complete() const;
  SessionEvents takeEvents();

  /// Cached bytes of a face value or null; touches the LRU.
  const base::Bytes* face(const repository::FaceKey& key);
  const base::Bytes* block(std::uint32_t group);
  const protocol::Frame* frame(std::uint32_t sequence) const;  ///< of the 4 newest that fit frame_bytes
  /// What the current picture is made of: never evicted until the next call says otherwise. Also makes it the most
  /// recently used.
  void setInUse(const std::vector<repository::FaceKey>& faces, const std::vector<std::uint32_t>& groups);
  const lod::patch::Hierarchy& hierarchy() const;
  bool hasGroup(std::uint32_t group) const;  ///< its block is cached
  const SessionStats& stats() const;
  const SessionOptions& options() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace client
