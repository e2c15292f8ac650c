#include "protocol/parts.h"

#include <algorithm>
#include <utility>

#include "base/check.h"

namespace protocol {

void PartSender::begin(base::Bytes message) {
  LUMIGRID_CHECK(!message.empty());
  message_ = std::move(message);
  sent_ = 0;
}

base::Bytes PartSender::next(std::size_t most_bytes) {
  LUMIGRID_CHECK(most_bytes > 0 && !empty());
  const auto begin = message_.begin() + static_cast<std::ptrdiff_t>(sent_);
  const std::size_t size = std::min(most_bytes, message_.size() - sent_);
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
  std::optional<base::Bytes>& whole = streams_[static_cast<std::size_t>(part.stream)];
  if (part.first) whole.emplace();
  if (!whole)
    return base::Error{base::ErrorCode::kInvalidInput, "Part message: its stream was not begun by a first part"};
  if (part.bytes.size() > kMaxServerMessage - whole->size())
    return base::Error{base::ErrorCode::kInvalidInput, "Part message: its parts are larger than 16 MiB together"};
  whole->insert(whole->end(), part.bytes.begin(), part.bytes.end());
  if (!part.last) return std::optional<base::Bytes>();
  return std::exchange(whole, std::nullopt);
}

void PartReceiver::clear() {
  streams_ = {};
}

}  // namespace protocol
