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
  /// Begins a message, encoded and not empty. What was not sent of another is given up.
  void begin(base::Bytes message);
  bool empty() const { return sent_ == message_.size(); }
  /// The next part, of at most so many bytes, above 0, as an encoded message. Not when empty.
  base::Bytes next(std::size_t most_bytes);
  /// Drops what was not sent; the receiver drops the rest with the next first part.
  void giveUp();

 private:
  Stream stream_;
  base::Bytes message_;
  std::size_t sent_ = 0;
};

/// The receiving end of all streams.
class PartReceiver {
 public:
  /// Accepts a part. Returns the bytes of the whole message with its last. An error where a stream begins in the
  /// middle, or the message becomes longer than kMaxServerMessage.
  base::Result<std::optional<base::Bytes>> accept(const Part& part);
  /// Drops what is unfinished, for a new connection.
  void clear();

 private:
  std::array<std::optional<base::Bytes>, kStreams> streams_;  ///< what has come of the message under way
};

}  // namespace protocol
