#pragma once
// Fetches small objects from the server over HTTP (picks, notes, pictures), one after the other on a thread of its own.
// The render loop never waits.
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "base/bytes.h"
#include "client/native/http_request.h"

namespace client {

class HttpGetter {
 public:
  struct Answer {
    std::uint64_t id = 0;
    int status = 0;       ///< HTTP status; 0 when nobody answered
    base::Bytes body;     ///< the body, whatever the status
    std::string problem;  ///< the reason when there is no answer, else empty
  };

  /// `place`: "http://host:port", or "https://host/folder", without a slash at its end.
  explicit HttpGetter(const std::string& place, const HostAccess& access = {}) : place_(place), client_(access) {}
  /// Aborts the request under way.
  ~HttpGetter();
  HttpGetter(const HttpGetter&) = delete;
  HttpGetter& operator=(const HttpGetter&) = delete;

  /// Requests a path and query below the place: "/pick?…". `max_bytes` limits the body, `seconds` the time from
  /// connecting to the last byte. At most kMaxQueue requests wait; those beyond are answered at once with a problem.
  void get(std::uint64_t id, const std::string& target, std::size_t max_bytes, double seconds);
  /// Returns the answers since the last call, in the order of the requests.
  std::vector<Answer> takeAnswers();

  static constexpr std::size_t kMaxQueue = 64;  ///< a choice: more than clicks make within an answer's time

 private:
  struct WaitingRequest {
    std::uint64_t id = 0;
    HttpRequest request;
  };
  void answerRequests(const std::stop_token& stop);
  Answer send(const WaitingRequest& waiting);

  const std::string place_;
  HttpClient client_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<WaitingRequest> requests_;
  std::vector<Answer> answers_;
  // Last member, since the thread uses all others and ends before them.
  std::jthread thread_{[this](const std::stop_token& stop) { answerRequests(stop); }};
};

}  // namespace client
