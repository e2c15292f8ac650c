#include "client/native/http_get.h"

#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>
#include <utility>

#include "client/native/http_request.h"

namespace client {
namespace {

struct WaitingRequest {
  std::uint64_t id = 0;
  HttpRequest request;
};

}  // namespace

struct HttpGetter::Impl {
  explicit Impl(const std::string& where) : place(where), thread([this] { answerRequests(); }) {}
  ~Impl() {
    {
      const std::lock_guard lock(mutex);
      stopping = true;
    }
    client.stop();
    changed.notify_all();
    thread.join();
  }

  void answerRequests() {
    std::unique_lock lock(mutex);
    for (;;) {
      changed.wait(lock, [this] { return stopping || !requests.empty(); });
      if (stopping) return;
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
  std::condition_variable changed;
  std::deque<WaitingRequest> requests;
  std::vector<Answer> answers;
  bool stopping = false;
  std::thread thread;  // last member, since the thread uses all others
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
