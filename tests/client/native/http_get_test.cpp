#include "client/native/http_get.h"

#include <gtest/gtest.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read_until.hpp>
#include <boost/asio/streambuf.hpp>
#include <boost/asio/write.hpp>
#include <chrono>
#include <functional>
#include <thread>

namespace client {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;

/// Answers each connection with the text that `reply` returns for the request's first line; an empty one means no
/// answer.
class CannedServer {
 public:
  explicit CannedServer(std::function<std::string(const std::string&)> reply)
      : acceptor_(io_, tcp::endpoint(asio::ip::address_v4::loopback(), 0)),
        reply_(std::move(reply)),
        port_(acceptor_.local_endpoint().port()),
        thread_([this] { serve(); }) {}
  ~CannedServer() {
    stopping_ = true;
    boost::system::error_code ignored;
    tcp::socket knock(io_);
    knock.connect({asio::ip::address_v4::loopback(), port_}, ignored);
    thread_.join();
  }
  std::string url() const { return "http://127.0.0.1:" + std::to_string(port_); }

 private:
  void serve() {
    for (;;) {
      tcp::socket socket(io_);
      boost::system::error_code error;
      acceptor_.accept(socket, error);
      if (error || stopping_) return;
      asio::streambuf request;
      asio::read_until(socket, request, "\r\n\r\n", error);
      const std::string text(asio::buffers_begin(request.data()), asio::buffers_end(request.data()));
      const std::string answer = reply_(text.substr(0, text.find("\r\n")));
      if (answer.empty())
        silent_.push_back(std::move(socket));
      else
        asio::write(socket, asio::buffer(answer), error);
    }
  }

  asio::io_context io_;
  tcp::acceptor acceptor_;
  std::function<std::string(const std::string&)> reply_;
  std::uint16_t port_;
  std::atomic<bool> stopping_{false};
  std::vector<tcp::socket> silent_;
  std::thread thread_;
};

std::string ok(const std::string& body) {
  return "HTTP/1.1 200 OK\r\nContent-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body;
}

HttpGetter::Answer wait(HttpGetter& getter) {
  for (int i = 0; i < 1000; ++i) {
    auto answers = getter.takeAnswers();
    if (!answers.empty()) return answers.front();
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  ADD_FAILURE() << "no answer came";
  return {};
}
std::string bodyOf(const HttpGetter::Answer& answer) {
  return {answer.body.begin(), answer.body.end()};
}

TEST(HttpGetter, questionsAreAnsweredInTurn) {
  const CannedServer server([](const std::string& line) { return ok(line); });
  HttpGetter getter(server.url());
  getter.get(5, "/pick?ox=1", 1000, 10.0);
  HttpGetter::Answer answer = wait(getter);
  EXPECT_EQ(answer.id, 5U);
  EXPECT_EQ(answer.status, 200);
  EXPECT_EQ(bodyOf(answer), "GET /pick?ox=1 HTTP/1.1");
  getter.get(6, "/b", 1000, 10.0);
  EXPECT_EQ(wait(getter).id, 6U);
}

TEST(HttpGetter, aRefusalKeepsItsStatus) {
  const CannedServer server(
      [](const std::string&) { return std::string("HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n"); });
  HttpGetter getter(server.url());
  getter.get(1, "/none", 1000, 10.0);
  const auto answer = wait(getter);
  EXPECT_EQ(answer.status, 404);
  EXPECT_TRUE(answer.problem.empty());
}

TEST(HttpGetter, aBodyThatIsTooLargeIsNotTaken) {
  const std::string chunked =
      "HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n1388\r\n" + std::string(5000, 'x') + "\r\n0\r\n\r\n";
  for (const std::string& text : {ok(std::string(5000, 'x')), chunked}) {
    const CannedServer server([&](const std::string&) { return text; });
    HttpGetter getter(server.url());
    getter.get(1, "/", 1000, 10.0);
    const auto answer = wait(getter);
    EXPECT_EQ(answer.status, 0);
    EXPECT_NE(answer.problem.find("too large"), std::string::npos);
  }
}

TEST(HttpGetter, answersThatAreNotHttpOrAreCutShortAreProblems) {
  for (const char* text : {"SSH-2.0-x\r\n\r\n", "HTTP/1.1 200 OK\r\nContent-Length: 100\r\n\r\nonly this"}) {
    const CannedServer server([text](const std::string&) { return std::string(text); });
    HttpGetter getter(server.url());
    getter.get(1, "/", 1000, 10.0);
    EXPECT_FALSE(wait(getter).problem.empty());
  }
}

TEST(HttpGetter, aServerThatSaysNothingIsGivenUp) {
  const CannedServer server([](const std::string&) { return std::string(); });
  HttpGetter getter(server.url());
  getter.get(1, "/", 1000, 0.2);
  EXPECT_FALSE(wait(getter).problem.empty());
}

TEST(HttpGetter, closingDoesNotWaitForAnAnswer) {
  const CannedServer server([](const std::string&) { return std::string(); });
  {
    HttpGetter getter(server.url());
    getter.get(1, "/", 1000, 1e6);
  }
  SUCCEED();
}

TEST(HttpGetter, theQueueIsLimited) {
  const CannedServer server([](const std::string&) { return std::string(); });
  HttpGetter getter(server.url());
  for (std::uint64_t i = 0; i < HttpGetter::kMaxQueue + 5; ++i) getter.get(i, "/", 1000, 1e6);
  EXPECT_FALSE(wait(getter).problem.empty());
}

}  // namespace
}  // namespace client
