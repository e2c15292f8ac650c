#pragma once
// Estimates how many bytes may be under way (Rusinkiewicz and Levoy 2001, section 3.5): just enough to keep the link
// busy, so that blocks of a new view do not wait behind those of an old one. The class has no clock: the caller passes
// seconds, from any zero, that never fall.
#include <cstdint>

namespace lod::qsplat {

class LinkEstimate {
 public:
  /// A request for so many bytes was sent.
  void recordRequest(std::uint64_t bytes, double now);
  /// An answer of `bytes` bytes came to a request for `asked` bytes that was sent at `sent_at`; `bytes` is 0 when the
  /// request failed.
  void recordAnswer(std::uint64_t asked, std::uint64_t bytes, double sent_at, double now);

  std::uint64_t bytesUnderWay() const { return under_way_; }
  double bytesPerSecond() const;  ///< over the last second or two in which the link was busy
  std::uint64_t maxBytesUnderWay() const;
  /// Returns how many bytes one more request may ask for now; 0: none may be sent.
  std::uint64_t roomForRequest() const;

 private:
  std::uint64_t under_way_ = 0;
  double last_ = 0.0;                   // time of the last answer, or of the first request after silence
  double bytes_ = 0.0, seconds_ = 0.0;  // weighted, the newest answers most
  double round_trip_ = -1.0;            // shortest one seen, seconds; below 0: not known
};

}  // namespace lod::qsplat
