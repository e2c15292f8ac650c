#pragma once
// HTTP byte ranges (RFC 9110, section 14): what a Range header asks of a body.
#include <cstdint>
#include <string>
#include <string_view>

namespace server {

struct ByteRange {
  enum class Kind {
    kWhole,         ///< no header, or one that is to be ignored (other units, several ranges, bad syntax): answer 200
    kPart,          ///< answer 206 with [first, first + length)
    kUnsatisfiable  ///< answer 416
  };
  Kind kind = Kind::kWhole;
  std::uint64_t first = 0;
  std::uint64_t length = 0;  ///< never reaches past the body
};

/// `header` is the value of Range ("bytes=0-99", "bytes=100-", "bytes=-5"), empty when there is none; `size` the bytes
/// of the body.
ByteRange parseByteRange(std::string_view header, std::uint64_t size);

/// The Content-Range header for a part of, or (unsatisfiable) a body of that size.
std::string contentRange(const ByteRange& range, std::uint64_t size);

}  // namespace server
