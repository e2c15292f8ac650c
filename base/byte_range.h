#pragma once
// Byte ranges of files, and how HTTP asks for them (RFC 9110, section 14): the header Range that a reader sends, and
// the header Content-Range that a server answers with.
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace base {

/// Bytes offset … offset + length − 1 of a file.
struct FileRange {
  std::uint64_t offset = 0, length = 0;

  bool operator==(const FileRange&) const = default;
};

/// The part of a body that a Range header asks for.
struct RangeRequest {
  enum class Kind {
    kWhole,         ///< no header, or one to be ignored (other units, several ranges, bad syntax): answer 200
    kPart,          ///< answer 206 with [first, first + length)
    kUnsatisfiable  ///< answer 416
  };
  Kind kind = Kind::kWhole;
  std::uint64_t first = 0;
  std::uint64_t length = 0;  ///< never reaches past the body
};

/// `header` is the value of Range ("bytes=0-99", "bytes=100-", "bytes=-5"), empty when there is none; `size` is the
/// length of the body in bytes.
RangeRequest parseRange(std::string_view header, std::uint64_t size);

/// The value of Content-Range in the answer: "bytes 0-99/1234", or "bytes */1234" for an unsatisfiable request.
std::string formatContentRange(const RangeRequest& range, std::uint64_t size);

/// A Content-Range header as a reader meets it: "bytes 0-99/1234", "bytes 0-99/*", "bytes */1234".
struct ContentRange {
  bool has_bytes = false;  ///< false for "bytes */1234"
  std::uint64_t first = 0, last = 0;
  std::optional<std::uint64_t> size;  ///< length of the whole object
};

/// Reads "bytes a-b/size"; nullopt for any other text, and where last < first or last >= size.
std::optional<ContentRange> parseContentRange(const std::string& text);

}  // namespace base
