#include "server/log/server_log.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <signal.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>
#include <vector>

#include "spdlog/spdlog.h"
#include "tests/support/temporary_directory.h"

namespace server {
namespace {

std::string textOf(const std::string& path) {
  std::ifstream in(path);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

std::size_t count(const std::string& text, const std::string& what) {
  std::size_t found = 0;
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += what.size()) ++found;
  return found;
}

// A pipe, or a pair of sockets, with a reader that the test moves.
class Reader {
 public:
  explicit Reader(bool sockets = false) {
    if (sockets)
      EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM, 0, ends_.data()), 0);
    else
      EXPECT_EQ(::pipe(ends_.data()), 0);
  }
  ~Reader() {
    closeReader();
    ::close(ends_[1]);
  }
  int writeEnd() const { return ends_[1]; }
  void closeReader() {
    if (ends_[0] >= 0) ::close(ends_[0]);
    ends_[0] = -1;
  }
  // Reads until the text holds `what`, or nothing has come for so many milliseconds.
  bool readUntil(const std::string& what, int patience = 10'000) {
    std::array<char, 65536> piece;
    while (text.find(what) == std::string::npos) {
      pollfd readable{ends_[0], POLLIN, 0};
      if (::poll(&readable, 1, patience) <= 0) return false;
      const ssize_t n = ::read(ends_[0], piece.data(), piece.size());
      if (n <= 0) return false;
      text.append(piece.data(), static_cast<std::size_t>(n));
    }
    return true;
  }
  std::string text;

 private:
  std::array<int, 2> ends_{-1, -1};
};

class ServerLogTest : public testing::Test {
 protected:
  void SetUp() override { ::signal(SIGPIPE, SIG_IGN); }
  std::unique_ptr<ServerLog> open(LogOptions options) {
    auto log = ServerLog::open(options);
    EXPECT_TRUE(log) << log.error().message;
    return std::move(*log);
  }
  LogOptions toFile() const {
    LogOptions options;
    options.file = directory_ / "log";
    return options;
  }
  const support::TemporaryDirectory directory_;
};

template <class Condition>
void waitFor(const Condition& condition) {
  for (int i = 0; i < 1000 && !condition(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
}

TEST_F(ServerLogTest, linesOfSpdlogAreInTheFileAtTheEnd) {
  {
    const auto log = open(toFile());
    log->install();
    spdlog::info("connect client={}", 1);
    spdlog::warn("refuse why={}", quoteText("\n"));
  }
  const std::string text = textOf(directory_ / "log");
  EXPECT_NE(text.find("Z info connect client=1\n"), std::string::npos) << text;
  EXPECT_NE(text.find("Z warning refuse why=\"\\x0a\"\n"), std::string::npos) << text;
}

TEST_F(ServerLogTest, aReaderThatDoesNotReadCostsLinesAndNeverWaits) {
  for (const bool sockets : {false, true}) {
    Reader reader(sockets);
    LogOptions options;
    options.descriptor = reader.writeEnd();
    options.max_lines = 100;
    options.lines_per_second = 0;
    const auto log = open(options);
    for (int i = 0; i < 100'000; ++i) log->add(LogLevel::kInfo, "connect client=" + std::to_string(i));
    EXPECT_GT(log->counts().dropped, 50'000U);
    ASSERT_TRUE(reader.readUntil("lines were dropped: whoever reads the log is too slow"));
    // The queue may still be full of what came before.
    for (int i = 0; i < 1000 && !reader.readUntil("again", 10); ++i) log->add(LogLevel::kInfo, "again");
    EXPECT_NE(reader.text.find("again"), std::string::npos);
    EXPECT_EQ(::fcntl(reader.writeEnd(), F_GETFL) & O_NONBLOCK, 0) << "others share the descriptor";
  }
}

TEST_F(ServerLogTest, theEndDoesNotWaitForAReaderThatDoesNotRead) {
  Reader reader;
  LogOptions options;
  options.descriptor = reader.writeEnd();
  options.lines_per_second = 0;
  auto log = open(options);
  for (int i = 0; i < 20'000; ++i) log->add(LogLevel::kInfo, "connect client=" + std::to_string(i));
  log.reset();
  SUCCEED() << "else this test does not end";
}

TEST_F(ServerLogTest, aReaderThatGoesAwayEndsNothing) {
  Reader reader;
  LogOptions options;
  options.descriptor = reader.writeEnd();
  const auto log = open(options);
  log->add(LogLevel::kInfo, "first");
  ASSERT_TRUE(reader.readUntil("first"));
  reader.closeReader();
  for (int i = 0; i < 5; ++i) log->add(LogLevel::kInfo, "more");
  waitFor([&] { return log->counts().failed == 5; });
  EXPECT_EQ(log->counts().failed, 5U);
}

TEST_F(ServerLogTest, aFullDiskEndsNothing) {
  LogOptions options;
  options.file = "/dev/full";
  const auto log = open(options);
  for (int i = 0; i < 5; ++i) log->add(LogLevel::kInfo, "more");
  waitFor([&] { return log->counts().failed == 5; });
  EXPECT_EQ(log->counts().failed, 5U);
  EXPECT_EQ(log->counts().written, 0U);
}

// The name stands for a full disk first, for a file with room then.
TEST_F(ServerLogTest, whenThereIsRoomAgainALineSaysHowManyAreLost) {
  std::filesystem::create_symlink("/dev/full", directory_ / "log");
  const auto log = open(toFile());
  for (int i = 0; i < 5; ++i) log->add(LogLevel::kInfo, "lost");
  waitFor([&] { return log->counts().failed == 5; });
  std::filesystem::remove(directory_ / "log");
  log->reopen();
  log->add(LogLevel::kInfo, "kept");
  waitFor([&] { return log->counts().written == 1; });
  const std::string text = textOf(directory_ / "log");
  EXPECT_NE(text.find("warning 5 lines are lost: No space left on device\n"), std::string::npos) << text;
  EXPECT_NE(text.find("info kept\n"), std::string::npos) << text;
}

TEST_F(ServerLogTest, aRenamedFileIsOpenedAnew) {
  const auto log = open(toFile());
  log->add(LogLevel::kInfo, "old");
  waitFor([&] { return log->counts().written == 1; });
  std::filesystem::rename(directory_ / "log", directory_ / "log.1");
  log->reopen();
  log->add(LogLevel::kInfo, "new");
  waitFor([&] { return log->counts().written == 2; });
  EXPECT_NE(textOf(directory_ / "log.1").find("old\n"), std::string::npos);
  EXPECT_EQ(textOf(directory_ / "log.1").find("new\n"), std::string::npos);
  EXPECT_NE(textOf(directory_ / "log").find("new\n"), std::string::npos);
}

TEST_F(ServerLogTest, aFileThatCannotBeOpenedAnewIsKept) {
  std::filesystem::create_directory(directory_ / "d");
  LogOptions options;
  options.file = directory_ / "d/log";
  const auto log = open(options);
  std::filesystem::rename(directory_ / "d", directory_ / "e");
  log->reopen();
  waitFor([&] { return log->counts().written == 1; });
  EXPECT_NE(textOf(directory_ / "e/log").find("cannot write the log to " + options.file), std::string::npos);
}

TEST_F(ServerLogTest, aFileThatCannotBeMadeIsAnError) {
  LogOptions options;
  options.file = directory_ / "none/log";
  const auto log = ServerLog::open(options);
  ASSERT_FALSE(log);
  EXPECT_NE(log.error().message.find(options.file), std::string::npos);
  EXPECT_NE(log.error().message.find("--log"), std::string::npos);
}

TEST_F(ServerLogTest, linesOverTheRateAreSummedUp) {
  {
    const auto log = open(toFile());
    for (int i = 0; i < 1000; ++i) log->add(LogLevel::kInfo, "connect client=" + std::to_string(i));
    log->add(LogLevel::kInfo, "other");
  }
  const std::string text = textOf(directory_ / "log");
  // Adding them may have taken more than a second on a machine that is busy.
  const std::size_t lines = count(text, "info connect client=");
  EXPECT_GE(lines, 20U);
  EXPECT_LT(lines, 1000U);
  EXPECT_EQ(count(text, "info other\n"), 1U);
  std::uint64_t left_out = 0;
  const std::string field = "kind=\"connect\" left_out=";
  for (std::size_t at = 0; (at = text.find(field, at)) != std::string::npos;) {
    at += field.size();
    left_out += std::stoull(text.substr(at));
  }
  EXPECT_EQ(lines + left_out, 1000U);
}

TEST_F(ServerLogTest, eachJsonLineIsAnObject) {
  LogOptions options = toFile();
  options.json = true;
  {
    const auto log = open(options);
    log->add(LogLevel::kInfo, "hello client=3 program=" + quoteText("\x1B]0;\xFF\"}\n"));
    log->add(LogLevel::kWarning, "words\nand more");
  }
  std::istringstream lines(textOf(directory_ / "log"));
  std::vector<nlohmann::json> objects;
  for (std::string line; std::getline(lines, line);) {
    objects.push_back(nlohmann::json::parse(line, nullptr, false));
    ASSERT_TRUE(objects.back().is_object()) << line;
  }
  ASSERT_EQ(objects.size(), 2U);
  EXPECT_EQ(objects[0]["client"], 3);
  EXPECT_EQ(objects[0]["program"], "\\x1b]0;\\xff\"}\\x0a");
  EXPECT_EQ(objects[1]["message"], "words\\x0aand more");
}

TEST_F(ServerLogTest, manyThreadsLoseNoLine) {
  LogOptions options = toFile();
  options.lines_per_second = 0;
  options.max_lines = 100'000;
  {
    const auto log = open(options);
    std::vector<std::jthread> threads;
    for (int t = 0; t < 8; ++t)
      threads.emplace_back([&] {
        for (int i = 0; i < 500; ++i) log->add(LogLevel::kInfo, "line");
      });
    threads.clear();
    EXPECT_EQ(log->counts().dropped, 0U);
  }
  const std::string text = textOf(directory_ / "log");
  EXPECT_EQ(count(text, "info line\n"), 4000U);
}

}  // namespace
}  // namespace server
