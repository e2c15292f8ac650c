#include "server/log/server_log.h"

#include <signal.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <string_view>
#include <system_error>
#include <thread>
#include <utility>

#include "server/log/log_output.h"
#include "server/log/log_queue.h"
#include "server/log/log_rate.h"
#include "spdlog/details/null_mutex.h"
#include "spdlog/sinks/base_sink.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

constexpr auto kLastPatience = std::chrono::seconds(1);     // for the lines that wait at the end
constexpr auto kPatience = std::chrono::milliseconds(100);  // between looks at whether the log ends or is reopened

LogLevel levelOf(spdlog::level::level_enum level) {
  if (level >= spdlog::level::err) return LogLevel::kError;
  return level == spdlog::level::warn ? LogLevel::kWarning : LogLevel::kInfo;
}

}  // namespace

struct ServerLog::State {
  State(const LogOptions& chosen, LogOutput opened)
      : options(chosen),
        output(std::move(opened)),
        queue(chosen.max_lines, chosen.max_bytes),
        rate(chosen.lines_per_second) {}

  void add(LogLevel level, std::string text);
  void runThread();
  std::optional<LogEntry> waitForEntry();
  void addSummaries();
  void write(const LogEntry& entry);
  bool writeLine(const std::string& line);
  bool shouldGiveUp();
  bool reopenFile();

  const LogOptions options;
  LogOutput output;              // used by the thread alone
  bool is_line_cut = false;      // used by the thread alone: a line was written in part
  std::uint64_t unreported = 0;  // used by the thread alone: lines that failed since the last one that did not
  std::thread thread;

  std::mutex mutex;
  std::condition_variable changed;
  std::condition_variable finished;
  LogQueue queue;
  LogRate rate;
  bool is_ending = false;
  bool is_finished = false;
  std::chrono::steady_clock::time_point deadline;  // once it ends

  std::atomic<bool> reopens = false;
  std::atomic<std::uint64_t> written = 0, dropped = 0, left_out = 0, failed = 0;
};

/// spdlog hands its messages to the sink, and may keep it longer than the log lives.
struct ServerLog::Installed {
  class Sink final : public spdlog::sinks::base_sink<spdlog::details::null_mutex> {
   public:
    explicit Sink(std::shared_ptr<State> state) : state_(std::move(state)) {}

   private:
    void sink_it_(const spdlog::details::log_msg& message) override {
      state_->add(levelOf(message.level), std::string(message.payload.data(), message.payload.size()));
    }
    void flush_() override {}
    const std::shared_ptr<State> state_;
  };
  std::shared_ptr<spdlog::logger> before;
};

base::Result<std::unique_ptr<ServerLog>> ServerLog::open(const LogOptions& options) {
  LogOutput output(options.descriptor);
  if (options.file.empty())
    return std::unique_ptr<ServerLog>(new ServerLog(std::make_shared<State>(options, std::move(output))));
  LUMIGRID_ASSIGN_OR_RETURN(auto file, LogOutput::openFile(options.file));
  return std::unique_ptr<ServerLog>(new ServerLog(std::make_shared<State>(options, std::move(file))));
}

/// The thread hears no signals, so that those come to whoever waits for them.
ServerLog::ServerLog(std::shared_ptr<State> state) : state_(std::move(state)) {
  sigset_t all, before;
  ::sigfillset(&all);
  ::pthread_sigmask(SIG_SETMASK, &all, &before);
  state_->thread = std::thread([state = state_] { state->runThread(); });
  ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

ServerLog::~ServerLog() {
  if (installed_) spdlog::set_default_logger(installed_->before);
  std::unique_lock lock(state_->mutex);
  state_->is_ending = true;
  state_->deadline = std::chrono::steady_clock::now() + kLastPatience;
  state_->changed.notify_all();
  const bool is_finished =
      state_->finished.wait_until(lock, state_->deadline + kPatience, [this] { return state_->is_finished; });
  lock.unlock();
  if (is_finished)
    state_->thread.join();
  else
    state_->thread.detach();  // it waits in a write
}

void ServerLog::install() {
  installed_ = std::make_unique<Installed>();
  installed_->before = spdlog::default_logger();
  auto logger = std::make_shared<spdlog::logger>("lumigrid", std::make_shared<Installed::Sink>(state_));
  logger->set_error_handler([](const std::string&) {});  // spdlog's own would write to standard error, and wait
  spdlog::set_default_logger(std::move(logger));
}

void ServerLog::add(LogLevel level, std::string text) {
  state_->add(level, std::move(text));
}

void ServerLog::reopen() {
  state_->reopens = true;
  const std::lock_guard lock(state_->mutex);
  state_->changed.notify_all();
}

LogCounts ServerLog::counts() const {
  return {state_->written, state_->dropped, state_->left_out, state_->failed};
}

void ServerLog::State::add(LogLevel level, std::string text) {
  const auto time = std::chrono::system_clock::now();
  const std::lock_guard lock(mutex);
  if (is_finished) return;
  if (!rate.admit(kindOfMessage(text), LogRate::Clock::now())) {
    ++left_out;
  } else if (!queue.push({time, level, std::move(text)})) {
    ++dropped;
    return;
  }
  changed.notify_one();
}

// ---- The thread

void ServerLog::State::runThread() {
  while (const std::optional<LogEntry> entry = waitForEntry()) write(*entry);
  const std::lock_guard lock(mutex);
  is_finished = true;
  finished.notify_all();
}

/// Nothing at the end.
std::optional<LogEntry> ServerLog::State::waitForEntry() {
  std::unique_lock lock(mutex);
  while (true) {
    if (reopens.exchange(false)) {
      lock.unlock();
      reopenFile();
      lock.lock();
    }
    addSummaries();
    if (is_ending && std::chrono::steady_clock::now() >= deadline) return std::nullopt;
    if (!queue.empty()) return queue.pop();
    if (is_ending) return std::nullopt;
    if (const auto next = rate.nextSummary())
      changed.wait_until(lock, *next);
    else
      changed.wait(lock);
  }
}

/// The mutex is locked.
void ServerLog::State::addSummaries() {
  const auto now = is_ending ? LogRate::Clock::time_point::max() : LogRate::Clock::now();
  for (const LogRate::Summary& summary : rate.takeSummaries(now)) {
    LogEntry entry{std::chrono::system_clock::now(), LogLevel::kInfo,
                   "more of a kind than are logged kind=" + quoteText(summary.kind) +
                       " left_out=" + std::to_string(summary.left_out)};
    if (!queue.push(std::move(entry))) ++dropped;
  }
}

void ServerLog::State::write(const LogEntry& entry) {
  const auto format = [this](const LogEntry& one) { return options.json ? formatJsonLine(one) : formatTextLine(one); };
  if (unreported > 0) {
    const std::string lines = unreported == 1 ? "1 line is lost: " : std::to_string(unreported) + " lines are lost: ";
    const std::string why = std::generic_category().message(output.error());
    if (writeLine(format({entry.time, LogLevel::kWarning, lines + why}))) unreported = 0;
  }
  if (writeLine(format(entry))) {
    ++written;
  } else {
    ++failed;
    ++unreported;
  }
}

/// False when the system refuses the line: waiting for a disk to have room would only lose others.
bool ServerLog::State::writeLine(const std::string& line) {
  std::string whole = is_line_cut ? '\n' + line : line;
  std::string_view rest = whole;
  while (true) {
    const LogOutput::Outcome outcome = output.write(rest, kPatience);
    is_line_cut = !rest.empty() && (is_line_cut || rest.size() < whole.size());
    if (outcome == LogOutput::Outcome::kWritten) return true;
    if (outcome == LogOutput::Outcome::kFailed || shouldGiveUp()) return false;
    if (reopens.exchange(false) && reopenFile()) {
      is_line_cut = false;
      whole = line;
      rest = whole;
    }
  }
}

bool ServerLog::State::shouldGiveUp() {
  const std::lock_guard lock(mutex);
  return is_ending && std::chrono::steady_clock::now() >= deadline;
}

/// False, and a line in the log as it was, when the file cannot be opened.
bool ServerLog::State::reopenFile() {
  const auto reopened = output.reopen();
  if (reopened) return true;
  const std::lock_guard lock(mutex);
  if (!queue.push({std::chrono::system_clock::now(), LogLevel::kWarning, reopened.error().message})) ++dropped;
  return false;
}

}  // namespace server
