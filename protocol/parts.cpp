#include "protocol/parts.h"

#include <algorithm>
#include <utility>

#include "base/check.h"

namespace protocol {

void PartSender::begin(base::Bytes message, std::size_t part_bytes) {
  LUMIGRID_CHECK(part_bytes > 0 && !message.empty());
  message_ = std::move(message);
  part_bytes_ = part_bytes;
  sent_ = 0;
}

base::Bytes PartSender::next() {
  LUMIGRID_CHECK(!empty());
  const auto begin = message_.begin() + static_cast<std::ptrdiff_t>(sent_);
  const std::size_t size = std::min(part_bytes_, message_.size() - sent_);
  Part part{stream_, sent_ == 0, sent_ + size == message_.size(), {begin, begin + static_cast<std::ptrdiff_t>(size)}};
  sent_ += size;
  if (part.last) giveUp();
  return encode(std::move(part));
}

void PartSender::giveUp() {
  message_.clear();
  sent_ = 0;
}

base::Result<std::optional<base::Bytes>> PartReceiver::accept(const Part& part) {
  Begun& stream = streams_[static_cast<std::size_t>(part.stream)];
  if (part.first) stream = {true, {}};
  if (!stream.begun)
    return base::Error{base::ErrorCode::kInvalidInput, "Part message: its stream was not begun by a first part"};
  if (part.bytes.size() > kMaxServerMessage - stream.bytes.size())
    return base::Error{base::ErrorCode::kInvalidInput, "Part message: its parts are larger than 16 MiB together"};
  stream.bytes.insert(stream.bytes.end(), part.bytes.begin(), part.bytes.end());
  if (!part.last) return std::optional<base::Bytes>();
  return std::optional(std::exchange(stream, {}).bytes);
}

void PartReceiver::clear() {
  streams_ = {};
}

}  // namespace protocol
