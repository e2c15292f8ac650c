#pragma once
// How many bytes may be under way (Rusinkiewicz and Levoy 2001, section 3.5): as many as keep the link busy, so that a
// new view does not wait behind an old one's. Has no clock; seconds from any zero, never falling.
#include <cstdint>

namespace lod::qsplat {

class LinkEstimate {
 public:
  /// A request for so many bytes left.
  void sent(std::uint64_t bytes, double now);
  /// An answer with so many bytes to a request that left at `sent_at`; 0 when it failed.
  void came(std::uint64_t asked, std::uint64_t bytes, double sent_at, double now);

  std::uint64_t bytesUnderWay() const { return under_way_; }
  double bytesPerSecond() const;  ///< of the last second or two in which there was something to bring
  std::uint64_t mostUnderWay() const;
  /// Bytes that one more request may ask for now; 0: none.
  std::uint64_t room() const;

 private:
  std::uint64_t under_way_ = 0;
  double last_ = 0.0;                   // an answer, or the first request after silence
  double bytes_ = 0.0, seconds_ = 0.0;  // weighted, the newest most
  double round_trip_ = -1.0;            // seconds; below 0: not known
};

}  // namespace lod::qsplat
