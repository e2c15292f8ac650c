#include "client/native/http_get.h"

#include <utility>

namespace client {

HttpGetter::~HttpGetter() {
  thread_.request_stop();
  client_.stop();
}

void HttpGetter::answerRequests(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (changed_.wait(lock, stop, [this] { return !requests_.empty(); }) && !stop.stop_requested()) {
    const WaitingRequest waiting = std::move(requests_.front());
    requests_.pop_front();
    lock.unlock();
    Answer answer = send(waiting);
    lock.lock();
    answers_.push_back(std::move(answer));
  }
}

HttpGetter::Answer HttpGetter::send(const WaitingRequest& waiting) {
  HttpResponse reply = client_.send(waiting.request);
  if (reply.problem.empty()) return {waiting.id, reply.head.status, std::move(reply.body), ""};
  return {waiting.id, 0, {}, "cannot ask " + place_ + ": " + reply.problem};
}

void HttpGetter::get(std::uint64_t id, const std::string& target, std::size_t max_bytes, double seconds) {
  HttpRequest request;
  request.url = place_ + target;
  request.max_bytes = max_bytes;
  request.seconds = seconds;
  {
    const std::lock_guard lock(mutex_);
    if (requests_.size() < kMaxQueue)
      requests_.push_back({id, std::move(request)});
    else
      answers_.push_back({id, 0, {}, "too many requests wait for the server already"});
  }
  changed_.notify_all();
}

std::vector<HttpGetter::Answer> HttpGetter::takeAnswers() {
  const std::lock_guard lock(mutex_);
  return std::exchange(answers_, {});
}

}  // namespace client
