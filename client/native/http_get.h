#pragma once
// Small things from the server over plain HTTP (picks, notes, pictures), on a thread of its own; one after the other.
// The render loop never waits.
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"

namespace client {

class HttpGetter {
 public:
  struct Answer {
    std::uint64_t id = 0;
    int status = 0;       ///< of HTTP; 0 when nobody answered
    base::Bytes body;     ///< whatever the status
    std::string problem;  ///< why there is no answer; else empty
  };

  /// `place`: "http://host:port", or "https://host/folder", without a slash at its end.
  explicit HttpGetter(const std::string& place);
  /// Breaks off what is under way.
  ~HttpGetter();
  HttpGetter(const HttpGetter&) = delete;
  HttpGetter& operator=(const HttpGetter&) = delete;

  /// Asks for a path and query below the place: "/pick?…". `max_bytes` of a body, `seconds` from connecting to the last
  /// byte. At most kMaxQueue wait; what is beyond is answered at once with a problem.
  void get(std::uint64_t id, const std::string& target, std::size_t max_bytes, double seconds);
  /// What has come since the last call, in the order of the asking.
  std::vector<Answer> takeAnswers();

  static constexpr std::size_t kMaxQueue = 64;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace client
