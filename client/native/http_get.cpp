#include "client/native/http_get.h"

#include <atomic>
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>
#include <utility>

namespace client {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using asio::ip::tcp;

struct Question {
  std::uint64_t id;
  std::string target;
  std::size_t max_bytes;
  double seconds;
};

/// One question from resolving to the last byte, a row of steps of which each starts the next.
class Exchange {
 public:
  Exchange(asio::io_context& io, const ServerUrl& server, const Question& question)
      : server_(server), resolver_(io), stream_(io) {
    answer_.id = question.id;
    request_ = {http::verb::get, question.target, 11};
    request_.set(http::field::host, server.authority());
    request_.set(http::field::user_agent, "lumigrid-view");
    request_.set(http::field::connection, "close");
    max_bytes_ = question.max_bytes;
    parser_.body_limit(max_bytes_);  // of bodies that do not say how long they are
    stream_.expires_after(
        std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::duration<double>(question.seconds)));
  }

  void start() {
    resolver_.async_resolve(server_.host, server_.port, [this](beast::error_code error, const auto& places) {
      if (error) return fail(error);
      stream_.async_connect(places, [this](beast::error_code failed, const auto&) {
        if (failed) return fail(failed);
        write();
      });
    });
  }
  HttpGetter::Answer take() { return std::move(answer_); }

 private:
  void write() {
    http::async_write(stream_, request_, [this](beast::error_code error, std::size_t) {
      if (error) return fail(error);
      read();
    });
  }
  /// The length is looked at before the body: what is too long is not read at all.
  void read() {
    http::async_read_header(stream_, buffer_, parser_, [this](beast::error_code error, std::size_t) {
      if (error) return fail(error);
      const auto length = parser_.content_length();
      if (length && *length > max_bytes_) return fail(http::error::body_limit);
      readBody();
    });
  }
  void readBody() {
    http::async_read(stream_, buffer_, parser_, [this](beast::error_code error, std::size_t) {
      if (error) return fail(error);
      answer_.status = static_cast<int>(parser_.get().result_int());
      answer_.body = std::move(parser_.get().body());
    });
  }
  void fail(beast::error_code error) {
    answer_.problem = "cannot ask " + server_.authority() + ": " +
                      (error == http::error::body_limit ? "the answer is too large" : error.message());
  }

  const ServerUrl& server_;
  tcp::resolver resolver_;
  beast::tcp_stream stream_;
  beast::flat_buffer buffer_{64 * 1024};
  http::request<http::empty_body> request_;
  http::response_parser<http::vector_body<std::uint8_t>> parser_;
  std::size_t max_bytes_ = 0;
  HttpGetter::Answer answer_;
};

}  // namespace

struct HttpGetter::State {
  explicit State(const ServerUrl& to) : server(to), thread([this] { work(); }) {}
  ~State() {
    {
      const std::lock_guard lock(mutex);
      stopping = true;
      if (running != nullptr) running->stop();
    }
    changed.notify_all();
    thread.join();
  }

  void work() {
    std::unique_lock lock(mutex);
    for (;;) {
      changed.wait(lock, [this] { return stopping || !questions.empty(); });
      if (stopping) return;
      const Question question = std::move(questions.front());
      questions.pop_front();
      asio::io_context io(1);
      running = &io;
      lock.unlock();

      Exchange exchange(io, server, question);
      exchange.start();
      io.run();

      lock.lock();
      running = nullptr;
      if (stopping) return;
      answers.push_back(exchange.take());
    }
  }

  const ServerUrl server;
  std::mutex mutex;
  std::condition_variable changed;
  std::deque<Question> questions;
  std::vector<Answer> answers;
  asio::io_context* running = nullptr;
  bool stopping = false;
  std::thread thread;  // last: it uses all of the above
};

HttpGetter::HttpGetter(const ServerUrl& server) : state_(std::make_unique<State>(server)) {}
HttpGetter::~HttpGetter() = default;

void HttpGetter::get(std::uint64_t id, const std::string& target, std::size_t max_bytes, double seconds) {
  {
    const std::lock_guard lock(state_->mutex);
    if (state_->questions.size() < kLongestQueue)
      state_->questions.push_back({id, target, max_bytes, seconds});
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
