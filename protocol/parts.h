#pragma once
// Messages in parts (docs/formats/protocol.md, Part): a large message on a slow link lets urgent ones through, or is
// given up.
#include <array>
#include <cstddef>
#include <optional>

#include "base/bytes.h"
#include "base/error.h"
#include "protocol/message.h"

namespace protocol {

/// The sending end of one stream.
class PartSender {
 public:
  explicit PartSender(Stream stream) : stream_(stream) {}
  /// Begins a message, encoded and not empty, in parts of so many bytes, above 0. What was not sent of another is given
  /// up.
  void begin(base::Bytes message, std::size_t part_bytes);
  bool empty() const { return sent_ == message_.size(); }
  /// The next part, as an encoded message. Not when empty.
  base::Bytes next();
  void giveUp();

 private:
  Stream stream_;
  base::Bytes message_;
  std::size_t part_bytes_ = 0, sent_ = 0;
};

/// The receiving end of all streams.
class PartReceiver {
 public:
  /// Accepts a part. Returns the bytes of the whole message with its last. An error where a stream begins in the
  /// middle, or the message becomes longer than kMaxServerMessage.
  base::Result<std::optional<base::Bytes>> accept(const Part& part);
  void clear();

 private:
  struct Begun {
    bool begun = false;
    base::Bytes bytes;
  };
  std::array<Begun, kStreams> streams_;
};

}  // namespace protocol
