#pragma once
// The server's side of one client: messages in, messages out. It knows no socket, no clock and no GL.
//
// The order of messages for a view (docs/formats/protocol.md draws the states):
//
//   1. The coarse whole model: group 0 and the next groups by error, about 40 kB. Sent once; again as far as evicted.
//   2. A quick exact frame as soon as it is rendered, if the view wants one and the server renders. It is requested
//      when the view arrives; other messages go meanwhile as far as they do not delay it. While the eye stands, it
//      comes right after group 0 and before the rest of 1. A moving eye gets frames aimed ahead (frame_schedule.h).
//   3. Groups and images of the view, in the order of what they gain for their bytes (plan/gain_order.h).
//   4. Completion; then the last frame, if the quick one had less than the wanted quality. It comes before 3 where it
//      takes the link a quarter of a second at most.
//   5. Prefetch: other directions at the same points, then faces along the motion, at most SceneData::ahead_bytes.
//
// Remote images (SceneData::images_are_remote) are sent when they have been fetched, the most useful first, and groups
// go meanwhile. A new view drops everything unsent. An evicted item is sent again only for a later view that needs it:
// a client whose cache is too small for its view would otherwise receive the same bytes for ever.
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "base/error.h"
#include "lod/patch/format.h"
#include "lod/patch/proxy_sight.h"
#include "plan/view_plan.h"
#include "protocol/message.h"
#include "protocol/parts.h"
#include "repository/access_counter.h"
#include "repository/sampling/sample_tree.h"
#include "repository/store.h"
#include "server/session/frame_schedule.h"
#include "server/session/held_faces.h"
#include "server/session/message_cache.h"

namespace server {

/// Views of a moving viewer that a server for which others wait plans for each second. Displays send a view with every
/// picture, which is more often than the choice of what to send changes.
inline constexpr double kViewsPerSecond = 13.0;
/// The same while others have all threads, but nobody waits: a view waits for 33 ms at most.
inline constexpr double kSharedViewsPerSecond = 30.0;

/// A session begins with this. Sessions of a scene share it for as long as the scene's Welcome stays the same: most
/// viewers of a server rest, and the memory that each takes limits how many they can be.
struct SessionStart {
  protocol::Welcome welcome;
  SharedMessage greeting;                          ///< `welcome`, encoded
  const lod::patch::PatchFile* patches = nullptr;  ///< as in SceneData
  std::vector<std::uint32_t> coarse;               ///< groups of the coarse model (plan::coarseGroups)
};

/// The data that all sessions of a scene share; outlives them. Read-only, except counter and caches and, for the thread
/// that makes sessions, `welcome` and `start`.
struct SceneData {
  protocol::Welcome welcome;                       ///< as new sessions take it
  const lod::patch::PatchFile* patches = nullptr;  ///< null: every client is refused, and told what there is instead
  protocol::Streamed instead = protocol::Streamed::kSplats;  ///< where `patches` is null
  const lod::patch::ProxySight* sight = nullptr;  ///< occlusion, for the choice of images; null: nothing is occluded
  plan::SightCache* sight_cache = nullptr;        ///< what `sight` told any session; null: nothing is remembered
  const repository::Store* images = nullptr;      ///< null: no repository
  bool images_are_remote = false;  ///< true: the caller fetches them for nextFaceRequest(); false: sessions read them
  bool images_are_webp = false;    ///< true: clients that do not decode WebP get none
  const repository::SampleTree* tree = nullptr;  ///< the sampled points; null: all of the grid
  repository::AccessCounter* access = nullptr;   ///< counts each face and group that nextMessage() returns; may be null
  /// Gets the error of each group or face that is not sent since it cannot be read or is damaged; may be empty. Called
  /// by any thread that uses a session.
  std::function<void(const base::Error&)> on_read_error;
  std::shared_ptr<HeldMemory> held;                  ///< of all viewers of the server; null: each has its own
  MessageCache* messages = nullptr;                  ///< of groups and local images; null: each session encodes its own
  std::uint64_t ahead_bytes = plan::kPrefetchBytes;  ///< prefetched per view after Completion; 0: nothing
  double views_per_second = kViewsPerSecond;         ///< of a moving viewer that are planned for while others wait
  int ray_step = 1;                                  ///< of plan::Scene, at least; at least 2 while others wait
  mutable std::shared_ptr<const SessionStart> start = nullptr;  ///< of the newest session; null: there was none

  plan::Scene toPlan() const { return {&welcome, &patches->hierarchy(), images != nullptr, tree, sight, sight_cache}; }
};

/// Returns `scene.start` for the scene's next session, made anew where Welcome or patches have changed. For the thread
/// that makes sessions.
std::shared_ptr<const SessionStart> startOf(const SceneData& scene);

/// Fills in what a client is told of the hierarchy.
void describeHierarchy(const lod::patch::Hierarchy& hierarchy, protocol::Welcome& welcome);

/// Faces to be fetched, the most useful first. They are of one view, hence of one neighbourhood in the store.
using FaceRequest = std::vector<repository::FaceKey>;

/// Counts of one session, for the server's log and metrics.
struct SessionCounts {
  std::uint64_t views = 0;                          ///< received
  std::uint64_t planned = 0;                        ///< views for which was chosen what to send
  std::uint64_t replaced = 0;                       ///< views that a newer one replaced before that
  std::uint64_t groups = 0, faces = 0, frames = 0;  ///< sent; of frames some parts of which may have been given up
  std::uint64_t bytes = 0;                          ///< bytes of all messages that nextMessage() returned
  std::uint64_t group_bytes = 0, face_bytes = 0, frame_bytes = 0;  ///< of those
  std::uint64_t missing = 0;  ///< wanted faces that the store lacks (not baked yet)
  std::uint64_t corrupt = 0;  ///< faces and blocks that could not be read or were damaged
};

/// How much there is to do for a server beside one session.
enum class Load {
  kFree,  ///< nobody waits, and there are threads left
  /// Others have the threads that are left. Nothing is prefetched, which takes as long as the view itself, and views of
  /// a motion are planned for a little less often than they may come.
  kShared,
  kBehind,  ///< others wait for a thread: views of a motion are planned for less often, and from fewer rays
};

class Session {
 public:
  explicit Session(const SceneData& scene);
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  /// Tells the time and how the link does. The transport calls it before each of the others; without it the session
  /// takes every view for one at which the eye stands, and every link for an idle one.
  void setLink(const LinkState& state);
  void setLoad(Load load) { load_ = load; }
  /// Accepts one message. An error ends the connection, after the Refusal that nextMessage() returns then.
  base::Result<void> receive(base::ByteView bytes);
  /// The next message to send, the most useful first; nullopt when there is none. Call it again only when the last one
  /// was written: that is the back-pressure.
  std::optional<SharedMessage> nextMessage();
  /// The same as far as it takes some microseconds: nothing is planned, read or encoded for it, so that groups and
  /// images come from the cache alone.
  std::optional<SharedMessage> nextReadyMessage();
  /// Once nextReadyMessage() has none: whether nextMessage() may have one.
  bool needsTime() const { return needs_time_; }
  /// The remote faces to fetch next: first all that the newest view needs, later, when the view is complete, those to
  /// prefetch. nullopt for local images and while two requests are under way. Only faces and Completion wait for the
  /// answers; nextMessage() returns other messages meanwhile.
  std::optional<FaceRequest> nextFaceRequest();
  /// Accepts the answer to a request: one value per key, as from Store::getMany. nextMessage() may have more to send
  /// then.
  using FaceValues = std::vector<base::Result<std::optional<base::Bytes>>>;
  void facesFetched(const FaceRequest& request, FaceValues values);
  /// The exact frame to render now, if there is one. Ask after every other call, whether messages are left or not. A
  /// request replaces an older one that is not answered yet.
  std::optional<FrameRequest> nextFrameRequest();
  /// Accepts the rendered frame; its value is empty when rendering failed. It is dropped when the viewer moved far
  /// away meanwhile.
  void frameRendered(const FrameRequest& request, protocol::EncodedFrame frame);
  /// When nextMessage() and nextFrameRequest() are to be asked again even if nothing happens until then, in the seconds
  /// of setLink(); nullopt: not at all. `tells_room`: setLink() will be called when the transport has written what it
  /// holds of the messages, as it does hold some.
  std::optional<double> wakeAt(bool tells_room = false) const;
  /// Once nextMessage() has none: whether it may have one as soon as bytes have left, though nothing else happens. Most
  /// sessions have sent all that they have by then, and need not be asked.
  bool needsRoom() const;
  /// Whether it has something to send that is not needed yet, and waits for the server to have time for it.
  bool waitsToPrefetch() const { return planned_ && complete_sent_ && load_ != Load::kFree && !prefetchIsOver(); }
  /// Whether a Refusal was sent: the connection is to be closed.
  bool finished() const { return phase_ == Phase::kRefused && !greeting_; }
  const std::string& clientName() const { return client_; }  ///< from Hello; empty before it
  const SessionCounts& counts() const { return counts_; }

 private:
  enum class Phase { kGreeting, kReady, kRefused };

  // ---- in ----
  base::Result<void> acceptMessage(const protocol::Hello& hello);
  base::Result<void> acceptMessage(const protocol::View& view);
  base::Result<void> acceptMessage(const protocol::Eviction& evicted);
  base::Result<void> acceptMessage(const protocol::Holdings& have);
  base::Error refuse(base::ErrorCode code, const std::string& reason);
  base::Error refuseWithoutPatches();

  // ---- out ----
  std::optional<SharedMessage> chooseMessage();
  bool takesTime();
  std::optional<SharedMessage> nextOfFrames();
  std::optional<SharedMessage> nextFrame();
  std::optional<SharedMessage> nextOfData();
  std::optional<SharedMessage> inParts(protocol::PartSender& stream, std::optional<SharedMessage> message) const;
  std::optional<SharedMessage> nextOther();
  std::optional<SharedMessage> nextCoarse();
  double coarseBytesNext() const;
  double partBytes() const;
  bool planIsDue() const;
  double nextPlanAt() const;
  SharedMessage nextPart(protocol::PartSender& stream) const;
  std::optional<SharedMessage> nextWanted();
  std::optional<SharedMessage> nextPrefetch();
  template <class Encode>
  std::optional<SharedMessage> encodedOnce(std::uint64_t key, Encode encode);
  std::optional<SharedMessage> groupMessage(std::uint32_t group);
  std::optional<SharedMessage> faceMessage(const repository::FaceKey& key);
  base::Result<base::Bytes> readGroup(std::uint32_t group) const;
  void countCorrupt(const base::Error& error);
  using Faces = std::vector<repository::FaceKey>;
  Faces::iterator findSendable(Faces& faces);
  std::optional<SharedMessage> removeAndEncode(Faces& faces, Faces::iterator face);
  FaceRequest unrequestedFaces(const Faces& faces, std::size_t max_count) const;
  void planPrefetch();
  bool prefetchIsOver() const;
  void planNewestView();
  plan::Scene sceneToPlan() const;
  plan::Holdings holdings() const;
  std::optional<SharedMessage> ancestorInstead(const repository::FaceKey& key);
  bool framePossible(const protocol::View& view) const;

  /// Images of a remote store.
  struct RemoteFaces {
    std::unordered_map<repository::FaceKey, base::Result<std::optional<base::Bytes>>> fetched;  // and not sent yet
    std::unordered_set<repository::FaceKey> requested;                                          // and not fetched yet
    std::size_t requests_under_way = 0;
    std::unordered_set<repository::FaceKey> absent;  // tiles that are known not to be stored
  };

  const SceneData& scene_;
  const std::shared_ptr<const SessionStart> start_;  // the scene's Welcome may change meanwhile
  Phase phase_ = Phase::kGreeting;
  std::string client_;
  SessionCounts counts_;

  // Data that the client holds.
  std::vector<bool> has_group_;
  HeldFaces held_;
  std::size_t faces_claimed_ = 0;
  bool decodes_webp_ = false, takes_coding_error_ = false;
  plan::ImageBytes image_bytes_;

  // Its views.
  std::shared_ptr<const protocol::View> newest_, previous_;  // null: there was none
  bool planned_ = false;  // the fields below belong to `newest_`, else to `previous_`
  Load load_ = Load::kFree;
  double planned_at_ = 0.0;  // seconds

  // While nextReadyMessage() looks for a message; where there is one that takes time, it stays the next.
  bool ready_only_ = false, needs_time_ = false;

  // Data to send for the newest view. A cursor runs over the groups, and faces leave their lists when they are sent;
  // those that the client received otherwise meanwhile are skipped.
  plan::ViewPlan view_plan_;
  std::size_t next_coarse_ = 0, next_group_ = 0;
  std::size_t faces_planned_ = 0;
  bool complete_sent_ = false;
  std::optional<Faces> prefetch_;
  std::uint64_t prefetch_bytes_ = 0;

  const std::unique_ptr<RemoteFaces> remote_;  // null: images are local

  FrameSchedule frames_;
  std::unique_ptr<const protocol::Frame> frame_;        // rendered and not sent yet; null: none
  std::unique_ptr<const base::ViewCamera> sent_frame_;  // of the newest frame that was begun; null: none
  protocol::PartSender frame_parts_{protocol::Stream::kFrames}, data_parts_{protocol::Stream::kData};
  std::optional<SharedMessage> greeting_;  // Welcome or Refusal, sent before all else
};

}  // namespace server
