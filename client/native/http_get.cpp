#include "client/native/http_get.h"

#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>
#include <utility>

#include "client/native/http_request.h"

namespace client {
namespace {

struct Waiting {
  std::uint64_t id = 0;
  HttpQuestion question;
};

}  // namespace

struct HttpGetter::State {
  explicit State(const std::string& where) : place(where), thread([this] { work(); }) {}
  ~State() {
    {
      const std::lock_guard lock(mutex);
      stopping = true;
    }
    client.stop();
    changed.notify_all();
    thread.join();
  }

  void work() {
    std::unique_lock lock(mutex);
    for (;;) {
      changed.wait(lock, [this] { return stopping || !questions.empty(); });
      if (stopping) return;
      const Waiting waiting = std::move(questions.front());
      questions.pop_front();
      lock.unlock();
      Answer answer = ask(waiting);
      lock.lock();
      answers.push_back(std::move(answer));
    }
  }

  Answer ask(const Waiting& waiting) {
    HttpReply reply = client.ask(waiting.question);
    if (reply.problem.empty()) return {waiting.id, reply.head.status, std::move(reply.body), ""};
    return {waiting.id, 0, {}, "cannot ask " + place + ": " + reply.problem};
  }

  const std::string place;
  HttpClient client;
  std::mutex mutex;
  std::condition_variable changed;
  std::deque<Waiting> questions;
  std::vector<Answer> answers;
  bool stopping = false;
  std::thread thread;  // last: it uses all of the above
};

HttpGetter::HttpGetter(const std::string& place) : state_(std::make_unique<State>(place)) {}
HttpGetter::~HttpGetter() = default;

void HttpGetter::get(std::uint64_t id, const std::string& target, std::size_t max_bytes, double seconds) {
  HttpQuestion question;
  question.url = state_->place + target;
  question.most_bytes = max_bytes;
  question.seconds = seconds;
  {
    const std::lock_guard lock(state_->mutex);
    if (state_->questions.size() < kLongestQueue)
      state_->questions.push_back({id, std::move(question)});
    else
      state_->answers.push_back({id, 0, {}, "too many questions wait for the server already"});
  }
  state_->changed.notify_all();
}

std::vector<HttpGetter::Answer> HttpGetter::take() {
  const std::lock_guard lock(state_->mutex);
  return std::exchange(state_->answers, {});
}

}  // namespace client
