#pragma once
// One client as the server sees it: messages in, messages out, no socket, no clock, no GL. DESIGN section 6, steps 1 to 5.
#include <memory>
#include <optional>
#include <string>

#include "base/error.h"
#include "lod/patch/format.h"
#include "protocol/message.h"
#include "repository/store.h"

namespace server {

/// What all sessions share; read-only, outlives them.
struct SceneData {
  protocol::Welcome welcome;
  const lod::patch::PatchFile* patches = nullptr;
  const repository::Store* images = nullptr;  ///< null: no repository
};

/// A frame that the session would like to have rendered.
struct FrameRequest {
  std::uint32_t sequence = 0;
  base::ViewCamera camera;
  int quality = 85;
};

class Session {
 public:
  explicit Session(const SceneData& scene);
  ~Session();

  /// Takes one message. An error ends the connection (send the Refusal that nextMessage() then yields first).
  base::Result<void> receive(base::ByteView bytes);
  /// The next message to send, the most useful first; nullopt when there is nothing to say. Call again once the last was written:
  /// that is the back-pressure.
  std::optional<base::Bytes> nextMessage();
  /// Non-null when everything else was sent and the client wants the exact picture of its newest view; asked once per view.
  std::optional<FrameRequest> takeFrameRequest();
  /// The rendered picture (a face value) for that view; dropped when a newer view came meanwhile and this one is far off.
  void frameRendered(const FrameRequest& request, base::Bytes value);
  bool finished() const;  ///< a refusal was said; close

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace server
