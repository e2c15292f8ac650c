// Messages of a server: any bytes are decoded or refused, and a decoded message encodes to one that decodes alike.
#include <cstdlib>

#include "protocol/message.h"
#include "tests/fuzz/fuzz.h"

namespace fuzz {

std::vector<base::Bytes> seeds() {
  using protocol::ServerMessage;
  protocol::Welcome welcome;
  welcome.scene_name = "scene";
  welcome.group_count = welcome.patch_count = 3;
  welcome.grid = {glm::vec3(-1.0F), 0.5F, glm::uvec3(5, 5, 5), 512};
  welcome.attribution = "A. Nonymous";
  welcome.background = base::Rgb{1, 2, 3};
  welcome.north = {0.0F, 1.0F, 0.0F};
  welcome.hull = {{1.0F, 2.0F, 3.0F}, {4.0F, 5.0F, 6.0F}};
  const base::Bytes some(20, 0x5A);
  return {protocol::encode(ServerMessage(welcome)),
          protocol::encode(ServerMessage(protocol::Face{{1, 2, 3, 4}, some})),
          protocol::encode(ServerMessage(protocol::Refinement{some, some})),
          protocol::encode(ServerMessage(protocol::Frame{1, {}, true, some})),
          protocol::encode(ServerMessage(protocol::Frame{1, {}, false, some, 0.25F})),
          protocol::encode(ServerMessage(protocol::Completion{7})),
          protocol::encode(ServerMessage(protocol::Refusal{2, "update the client"})),
          protocol::encode(ServerMessage(protocol::Part{protocol::Stream::kFrames, true, false, some}))};
}

void fuzzOne(base::ByteView bytes) {
  auto message = protocol::decodeServerMessage(bytes);
  if (!message) return;
  const base::Bytes once = protocol::encode(*message);
  auto again = protocol::decodeServerMessage(once);
  if (!again || protocol::encode(*again) != once) std::abort();
}

}  // namespace fuzz
