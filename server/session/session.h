#pragma once
// One client as the server sees it: messages in, messages out, no socket, no clock, no GL. DESIGN section 6, steps 1
// to 5.
//
// Order of what is sent for a view (docs/formats/protocol.md draws the states):
//   1. the coarse whole model: group 0 and the next by error, about 50 kB (once; again what the client evicted)
//   2. groups and faces of the view. Groups alone while the largest projected error that is missing exceeds four times
//   the tolerance (an
//      image thrown on a proxy that far off is a blur); then whichever of the two kinds had fewer bytes in this view
//      goes next
//   3. Completion; then the exact frame, when the view wants one and somebody renders it
//   4. at rest: other directions at the same points, then faces along the motion, at most SceneData::ahead_bytes beyond
//   Completion
// Where images are far away (SceneData::images_are_far) a face is sent when it has been fetched: of those that are here
// the most useful goes first, and groups go meanwhile. A new view drops all that was not sent yet. What a client evicts
// is sent again for the next view that needs it, not before: a client whose cache is too small for its view would
// otherwise be sent the same bytes for ever.
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "lod/patch/format.h"
#include "lod/patch/proxy_sight.h"
#include "plan/view_plan.h"
#include "protocol/message.h"
#include "repository/access_counter.h"
#include "repository/sampling/sample_tree.h"
#include "repository/store.h"

namespace server {

/// What all sessions share; outlives them. Read-only but for the counter.
struct SceneData {
  protocol::Welcome welcome;
  const lod::patch::PatchFile* patches = nullptr;  ///< null: the scene has splats alone; every client is refused
  const lod::patch::ProxySight* sight = nullptr;   ///< what hides what, for the choice of images; null: nothing does
  const repository::Store* images = nullptr;       ///< null: no repository
  bool images_are_far = false;                   ///< each takes round trips: fetched by takeFaceRequest, not read here
  const repository::SampleTree* tree = nullptr;  ///< which points are sampled; null: all of the grid
  repository::AccessCounter* access = nullptr;   ///< told of every face and group that nextMessage() hands out; or null
  std::uint64_t ahead_bytes = plan::kPrefetchBytes;  ///< sent beyond what a view needs, once it has that; 0: nothing

  plan::Scene toPlan() const { return {&welcome, &patches->hierarchy(), images != nullptr, tree, sight}; }
};

/// A frame that the session would like to have rendered.
struct FrameRequest {
  std::uint32_t sequence = 0;
  base::ViewCamera camera;
  int quality = 85;
};

/// Faces that the session would like to have, the most useful first: of one view, so of a neighbourhood.
using FaceRequest = std::vector<repository::FaceKey>;

/// What a session did, for the server's log.
struct SessionCounts {
  std::uint64_t views = 0, groups = 0, faces = 0, frames = 0;  ///< received; sent; sent; sent
  std::uint64_t bytes = 0;                                     ///< handed out by nextMessage()
  std::uint64_t missing = 0;                                   ///< faces wanted that the store lacks (not baked yet)
  std::uint64_t corrupt = 0;                                   ///< faces and blocks whose checksum failed
};

/// Most faces that a client may claim to hold; a cache of 50 MB holds some 2 000.
inline constexpr std::size_t kMaxFacesHeld = 1'000'000;

class Session {
 public:
  explicit Session(const SceneData& scene);
  ~Session();

  /// Takes one message. An error ends the connection (send the Refusal that nextMessage() then yields first).
  base::Result<void> receive(base::ByteView bytes);
  /// The next message to send, the most useful first; nullopt when there is nothing to say. Call again once the last
  /// was written: that is the back-pressure.
  std::optional<base::Bytes> nextMessage();
  /// Where images are far: what is to be fetched now, all that the newest view needs at once; later, when the view is
  /// complete, what may be needed next. Nothing while two requests are under way. What nextMessage() has to say does
  /// not wait for it, but for the faces themselves and Completion.
  std::optional<FaceRequest> takeFaceRequest();
  /// The answer: one value a key, as Store::getMany gives them. Then nextMessage() may have more to say.
  using FaceValues = std::vector<base::Result<std::optional<base::Bytes>>>;
  void facesFetched(const FaceRequest& request, FaceValues values);
  /// Non-null when everything else was sent and the client wants the exact picture of its newest view; asked once per
  /// view.
  std::optional<FrameRequest> takeFrameRequest();
  /// The rendered picture (a face value) for that view; dropped when a newer view came meanwhile and this one is far
  /// off. Empty: could not be rendered.
  void frameRendered(const FrameRequest& request, base::Bytes value);
  bool finished() const;                  ///< a refusal was said; close
  const std::string& clientName() const;  ///< from Hello; empty before
  const SessionCounts& counts() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace server
