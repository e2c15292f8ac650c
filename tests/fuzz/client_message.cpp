// Messages of a client: any bytes are decoded or refused, and a decoded message encodes to one that decodes alike.
#include <cstdlib>

#include "protocol/message.h"
#include "tests/fuzz/fuzz.h"

namespace fuzz {

std::vector<base::Bytes> seeds() {
  using protocol::ClientMessage;
  protocol::View view;
  view.sequence = 1;
  return {protocol::encode(ClientMessage(protocol::Hello{protocol::kVersion, "viewer 1", protocol::kDecodesWebp})),
          protocol::encode(ClientMessage(view)),
          protocol::encode(ClientMessage(protocol::Eviction{{{1, 2, 3, 4}, {5, 6, 7, 0}}, {8, 9}})),
          protocol::encode(ClientMessage(protocol::Holdings{{{1, 2, 3, 4}}, {}}))};
}

void fuzzOne(base::ByteView bytes) {
  auto message = protocol::decodeClientMessage(bytes);
  if (!message) return;
  // Decoding normalises directions and drops the rest of a Hello of another version; a second round changes nothing.
  const base::Bytes once = protocol::encode(*message);
  auto again = protocol::decodeClientMessage(once);
  if (!again || protocol::encode(*again) != once) std::abort();
}

}  // namespace fuzz
