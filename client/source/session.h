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
#include <deque>
#include <optional>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/view_defaults.h"
#include "client/source/method.h"
#include "lod/patch/traverse.h"
#include "protocol/message.h"
#include "protocol/parts.h"
#include "repository/cache.h"

namespace client {

enum class SessionPhase { kDisconnected, kGreeting, kReady, kRefused };

struct SessionOptions {
  std::uint64_t cache_bytes = 50'000'000;  ///< compressed faces and patches, LRU (Okamoto 2011, section 6: 50 MB)
  std::uint64_t frame_bytes =
      16'000'000;  ///< exact frames kept in coded form, the newest first; a frame larger than this is dropped
  bool images = true;
  bool frames = true;
  float patch_tolerance_px = base::ViewDefaults::kPatchTolerance;  ///< of patches under images
  float alone_tolerance_px = base::ViewDefaults::kAloneTolerance;  ///< of patches where no images are used
  bool guarantee = false;  ///< patches are refined until their proved bounds are within the tolerance
  /// Once a view has all that it needs and no exact frame will come, patches under images are refined like those alone,
  /// until their colours are right as well (refine()); and the server may end with a frame without loss.
  bool refine = true;
  /// A frame for a moving eye may have so many pixels, if those of the view are fewer. 0: as many as the view.
  std::uint32_t frame_pixels = 0;
  std::uint32_t max_triangles = base::ViewDefaults::kMaxTriangles;
  std::uint32_t max_triangles_refined = base::ViewDefaults::kRefinedFactor * base::ViewDefaults::kMaxTriangles;
  std::uint16_t max_points = base::ViewDefaults::kPoints;

  void setPatchTolerance(float px) { patch_tolerance_px = alone_tolerance_px = px; }  ///< under images or not
};

struct SessionStats {
  std::uint64_t bytes_received = 0, bytes_faces = 0, bytes_patches = 0, bytes_frames = 0;
  std::uint64_t messages_received = 0, faces_received = 0, groups_received = 0, frames_received = 0;
  std::uint64_t views_sent = 0;
  std::uint64_t cache_bytes = 0;  ///< compressed faces and patches held
  std::uint64_t frame_bytes = 0;  ///< exact frames held
};

/// How far patches are refined.
struct PatchGoal {
  float tolerance_px = 0.0F;  ///< of projected errors
  base::ErrorMeasure measure = base::ErrorMeasure::kVisible;
  std::uint32_t max_triangles = 0;  ///< … or up to this
};

/// Changes since the last call to takeEvents(), from which the renderer decides what to decode, upload or drop.
struct SessionEvents {
  bool welcomed = false;  ///< the first Welcome arrived, or one of another scene: everything known before is void
  std::vector<repository::FaceKey> faces_added, faces_evicted;
  std::vector<std::uint32_t> groups_added, groups_evicted;
  std::vector<std::uint32_t> frames_added;  ///< their numbers: frames are counted as they arrive, from 1
};

class Session {
 public:
  explicit Session(const SessionOptions& options) : options_(options), cache_(options.cache_bytes) {}
  Session(Session&&) noexcept = default;
  Session& operator=(Session&&) noexcept = default;

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
  SessionPhase phase() const { return phase_; }
  /// The reason when disconnected or refused; empty when all is well.
  const std::string& problem() const { return problem_; }
  /// After a refusal: the method of a viewer that would not be refused, because the scene has no patches, or lacks the
  /// file of the method.
  std::optional<Method> methodInstead() const { return method_instead_; }
  /// Null before the first Welcome.
  const protocol::Welcome* welcome() const { return welcome_ ? &*welcome_ : nullptr; }
  /// Whether the server sent everything for the newest view and, where exact frames were requested, the last of them
  /// arrived too.
  bool complete() const;
  /// Whether finer patches than the complete view has may still be asked for by refine().
  bool mayRefine() const;
  /// Asks for finer patches, until the next view, if mayRefine(). complete() is false until they are here.
  void refine();
  /// Whether that was asked for the newest view.
  bool refined() const { return refined_; }
  SessionEvents takeEvents() { return std::exchange(events_, {}); }
  /// Whether a frame came that takeEvents() did not return yet.
  bool hasNewFrame() const { return !events_.frames_added.empty(); }

  /// Returns the cached bytes of a face or of a group's block, null when they are not cached. Both count as a use in
  /// the LRU order.
  const base::Bytes* face(const repository::FaceKey& key) { return cache_.find(key.code()); }
  const base::Bytes* block(std::uint32_t group) { return cache_.find(kGroupTag | group); }
  /// One of the 4 newest that fit into frame_bytes, else null. A view may have several, the newest being the best.
  const protocol::Frame* frame(std::uint32_t number) const;
  /// Names what the current picture consists of. It is never evicted until the next call names something else, and
  /// counts as the most recently used.
  void setInUse(const std::vector<repository::FaceKey>& faces, const std::vector<std::uint32_t>& groups);
  const lod::patch::Hierarchy& hierarchy() const { return hierarchy_; }
  /// Whether the group's block is cached.
  bool hasGroup(std::uint32_t group) const { return cache_.contains(kGroupTag | group); }
  const SessionStats& stats() const { return stats_; }
  const SessionOptions& options() const { return options_; }
  /// Returns what any picture is drawn from at least. With images, if they are wanted and, as far as is known yet,
  /// there are any, errors are of shape, since images bring the colours; without them the visible ones, or the bounds.
  PatchGoal usualPatches() const;
  /// And what refine() asks for: visible errors, as without images.
  PatchGoal finePatches() const;

 private:
  bool showsImages() const;
  /// Returns what the next view asks for. Close to the surface patches have its colours sooner than images do, so a
  /// moving eye that gets images, too, asks by visible errors: the order by gain decides (plan/gain_order.h). A view
  /// that stands has images first, then its frame, or refine().
  PatchGoal wantedPatches() const;
  /// Faces and groups share one cache. A face's key is its code (63 bits), a group's its number with the highest bit
  /// set.
  using CacheKey = std::uint64_t;
  static constexpr CacheKey kGroupTag = CacheKey{1} << 63U;
  static bool isGroup(CacheKey key) { return (key & kGroupTag) != 0; }
  static std::uint32_t groupOf(CacheKey key) { return static_cast<std::uint32_t>(key & ~kGroupTag); }

  base::Result<void> acceptWelcome(protocol::Welcome&& message);
  base::Result<void> acceptFace(protocol::Face&& message, std::size_t bytes);
  base::Result<void> acceptRefinement(protocol::Refinement&& message, std::size_t bytes);
  base::Result<void> acceptFrame(protocol::Frame&& message, std::size_t bytes);
  base::Result<void> acceptCompletion(const protocol::Completion& message);
  base::Result<void> acceptRefusal(const protocol::Refusal& message);
  base::Result<void> acceptMessage(protocol::ServerMessage&& message, std::size_t bytes);
  base::Result<void> acceptBytes(base::ByteView bytes);

  void startScene(const protocol::Welcome& message);
  bool insert(CacheKey key, base::Bytes&& bytes);
  void evictOverBudget();
  void forget(CacheKey key);
  bool pinned(CacheKey key) const;
  void queueHave();
  base::Bytes evictedMessage();
  base::Bytes viewMessage();
  std::uint64_t frameBytes() const;
  bool wantsFrame() const { return options_.frames && welcome_->can_render_frames; }

  SessionOptions options_;
  SessionPhase phase_ = SessionPhase::kDisconnected;
  std::string problem_;
  std::optional<Method> method_instead_;
  std::optional<protocol::Welcome> welcome_;
  lod::patch::Hierarchy hierarchy_;

  repository::LruCache<CacheKey, base::Bytes> cache_;
  std::unordered_map<std::uint32_t, std::uint32_t>
      cached_children_;  // per group: cached groups that have it as a parent
  std::unordered_set<CacheKey> in_use_;
  struct NumberedFrame {
    std::uint32_t number;
    protocol::Frame frame;
  };
  std::deque<NumberedFrame> frames_;       // oldest first
  std::uint32_t frame_number_ = 0;         // of the newest, kept or not
  std::uint32_t last_frame_sequence_ = 0;  // view whose last frame arrived newest, kept or not

  protocol::PartReceiver parts_;
  std::deque<base::Bytes> greetings_;            // Hello or Holdings, sent before anything else
  std::unordered_set<CacheKey> unreported_;      // evicted, and the server does not know yet
  std::optional<base::ViewCamera> camera_;       // the newest
  std::optional<base::ViewCamera> sent_camera_;  // of the last View
  std::uint32_t sequence_ = 0;                   // number of the newest view
  std::uint32_t complete_sequence_ = 0;
  bool view_unsent_ = false;
  bool refined_ = false;
  bool is_moving_ = false;         // the last step was one of a moving eye
  bool frames_asked_for_ = false;  // on this connection

  SessionEvents events_;
  SessionStats stats_;
};

}  // namespace client
