#include "client/native/http_get.h"

#include <condition_variable>
#include <deque>
#include <mutex>
#include <stop_token>
#include <thread>
#include <utility>

#include "client/native/http_request.h"

namespace client {
struct HttpGetter::Impl {
  struct WaitingRequest {
    std::uint64_t id = 0;
    HttpRequest request;
  };

  explicit Impl(const std::string& where) : place(where) {}
  ~Impl() {
    thread.request_stop();
    client.stop();
  }

  void answerRequests(const std::stop_token& stop) {
    std::unique_lock lock(mutex);
    while (changed.wait(lock, stop, [this] { return !requests.empty(); }) && !stop.stop_requested()) {
      const WaitingRequest waiting = std::move(requests.front());
      requests.pop_front();
      lock.unlock();
      Answer answer = send(waiting);
      lock.lock();
      answers.push_back(std::move(answer));
    }
  }

  Answer send(const WaitingRequest& waiting) {
    HttpResponse reply = client.send(waiting.request);
    if (reply.problem.empty()) return {waiting.id, reply.head.status, std::move(reply.body), ""};
    return {waiting.id, 0, {}, "cannot ask " + place + ": " + reply.problem};
  }

  const std::string place;
  HttpClient client;
  std::mutex mutex;
  std::condition_variable_any changed;
  std::deque<WaitingRequest> requests;
  std::vector<Answer> answers;
  // Last member, since the thread uses all others and ends before them.
  std::jthread thread{[this](const std::stop_token& stop) { answerRequests(stop); }};
};

HttpGetter::HttpGetter(const std::string& place) : impl_(std::make_unique<Impl>(place)) {}
HttpGetter::~HttpGetter() = default;

void HttpGetter::get(std::uint64_t id, const std::string& target, std::size_t max_bytes, double seconds) {
  HttpRequest request;
  request.url = impl_->place + target;
  request.max_bytes = max_bytes;
  request.seconds = seconds;
  {
    const std::lock_guard lock(impl_->mutex);
    if (impl_->requests.size() < kMaxQueue)
      impl_->requests.push_back({id, std::move(request)});
    else
      impl_->answers.push_back({id, 0, {}, "too many requests wait for the server already"});
  }
  impl_->changed.notify_all();
}

std::vector<HttpGetter::Answer> HttpGetter::takeAnswers() {
  const std::lock_guard lock(impl_->mutex);
  return std::exchange(impl_->answers, {});
}

}  // namespace client
