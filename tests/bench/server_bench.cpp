// server_bench SCENE [--viewers 64] [--idle 1000] [--rate 10] [--seconds 8] [--rounds 3] [--visit 8]
// [--only throughput|flying]: a server of many viewers who fly, beside a bare Beast server that sends the same messages
// in the same run.
//
//   throughput   each viewer jumps to the next view as soon as the last is complete, and comes back as a new one after
//                as many views as --visit says; the peer sends what the server sent for such a visit, view by view
//   flying       each viewer circles the scene and sends so many views a second
//   idle         as many viewers as --idle asks for are connected and look at one view
//
// The viewers run on a thread of this program (ws_viewer.h), the server in a process of its own. The rows tell the
// ratio to the peer, and for latencies the time from sending a view to the first byte of a message for it.
#include <sys/epoll.h>
#include <sys/wait.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "protocol/message.h"
#include "tests/bench/bench.h"
#include "tests/server/net/loopback.h"
#include "tests/support/ws_viewer.h"

namespace {

using bench::must;

constexpr std::uint8_t kFace = 0x82, kRefinement = 0x83, kCompletion = 0x85;

/// `lumigrid serve` as a child that ends with the object.
class ServeProcess {
 public:
  explicit ServeProcess(const std::string& scene) {
    int out[2];
    if (::pipe(out) != 0) bench::stop("no pipe");
    pid_ = ::fork();
    if (pid_ == 0) {
      ::dup2(out[1], 1);
      const base::FileDescriptor quiet(::open("/dev/null", O_WRONLY));
      ::dup2(quiet.get(), 2);
      ::execl(LUMIGRID_PROGRAM, "lumigrid", "serve", scene.c_str(), "--port", "0", "--json", "--no-frames",
              "--no-access", "--max-connections", "4000", "--connections-per-address", "4000", nullptr);
      ::_exit(127);
    }
    ::close(out[1]);
    std::string line;
    for (char c = 0; ::read(out[0], &c, 1) == 1 && c != '\n';) line += c;
    ::close(out[0]);
    const auto at = line.find("\"port\":");
    if (at == std::string::npos) bench::stop("lumigrid serve did not start");
    port = static_cast<std::uint16_t>(std::strtoul(line.c_str() + at + 7, nullptr, 10));
  }
  ~ServeProcess() {
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
  }
  ServeProcess(const ServeProcess&) = delete;
  ServeProcess& operator=(const ServeProcess&) = delete;

  /// CPU seconds of all its threads.
  double cpuSeconds() const {
    std::ifstream in("/proc/" + std::to_string(pid_) + "/stat");
    std::string line;
    std::getline(in, line);
    line = line.substr(line.rfind(')') + 2);
    unsigned long user = 0, system = 0;
    std::sscanf(line.c_str(), "%*c %*d %*d %*d %*d %*d %*u %*u %*u %*u %*u %lu %lu", &user, &system);
    return static_cast<double>(user + system) / static_cast<double>(::sysconf(_SC_CLK_TCK));
  }
  /// Resident bytes.
  double memory() const {
    std::ifstream in("/proc/" + std::to_string(pid_) + "/statm");
    double pages = 0.0, resident = 0.0;
    in >> pages >> resident;
    return resident * static_cast<double>(::sysconf(_SC_PAGESIZE));
  }
  std::uint16_t port = 0;

 private:
  pid_t pid_ = 0;
};

/// Times in seconds and what was counted along a run.
struct Measured {
  std::vector<double> first, groups, complete;  // from a view to its first message, last group, completion
  std::uint64_t bytes = 0, views = 0, completed = 0;
  double seconds = 0.0;
};

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1, static_cast<std::size_t>(q * static_cast<double>(values.size())))];
}

/// A view of a circle above the scene that looks at its middle; `turn` in turns.
protocol::View viewOf(const protocol::Welcome& welcome, std::uint32_t sequence, double turn) {
  const glm::dvec3 middle = welcome.origin + glm::dvec3(0.5F * (welcome.box_min + welcome.box_max));
  const glm::dvec3 size = glm::dvec3(welcome.box_max - welcome.box_min);
  const double reach = 0.45 * std::max({size.x, size.y, size.z});
  const double angle = 2.0 * std::numbers::pi * turn;
  glm::dvec3 up = glm::dvec3(welcome.up);
  const glm::dvec3 side =
      glm::normalize(glm::cross(up, std::abs(up.x) < 0.9 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0)));
  const glm::dvec3 other = glm::cross(up, side);
  protocol::View view;
  view.sequence = sequence;
  view.camera.position = middle + reach * (std::cos(angle) * side + std::sin(angle) * other + 0.6 * up);
  view.camera.direction = glm::normalize(middle - view.camera.position);
  view.camera.up = up;
  view.camera.width = 1280;
  view.camera.height = 720;
  view.max_triangles = 1'000'000;
  return view;
}

/// One viewer of a run.
class Flyer {
 public:
  Flyer(Measured& measured, double phase, bool speaks) : measured_(measured), phase_(phase), speaks_(speaks) {}

  bool open(std::uint16_t port) {
    viewer_ =
        std::make_unique<support::WsViewer>([this](base::ByteView front, std::size_t size) { accept(front, size); });
    if (!viewer_->open(port)) return false;
    return !speaks_ || viewer_->send(protocol::encode(protocol::ClientMessage(protocol::Hello{})));
  }
  bool ready(const protocol::Welcome& welcome) {
    welcome_ = &welcome;
    return true;
  }
  void look(double turn) {
    sent_at_ = bench::seconds();
    got_first_ = false;
    last_group_ = 0.0;
    ++measured_.views;
    viewer_->send(protocol::encode(protocol::ClientMessage(viewOf(*welcome_, ++sequence_, turn + phase_))));
    is_complete_ = false;
  }
  bool isComplete() const { return is_complete_; }
  support::WsViewer& viewer() { return *viewer_; }
  std::uint32_t sequence() const { return sequence_; }

 private:
  void accept(base::ByteView front, std::size_t size) {
    if (front.empty()) return;
    const double now = bench::seconds();
    measured_.bytes += size;
    const bool is_data = front[0] == kFace || front[0] == kRefinement;
    if (is_data && !std::exchange(got_first_, true)) measured_.first.push_back(now - sent_at_);
    if (front[0] == kRefinement) last_group_ = now - sent_at_;
    if (front[0] != kCompletion || size < 5) return;
    const std::uint32_t sequence = front[1] | front[2] << 8U | front[3] << 16U | std::uint32_t{front[4]} << 24U;
    if (speaks_ && sequence != sequence_) return;  // the peer says what it said once
    is_complete_ = true;
    ++measured_.completed;
    measured_.complete.push_back(now - sent_at_);
    if (last_group_ > 0.0) measured_.groups.push_back(last_group_);
  }

  Measured& measured_;
  const double phase_;
  std::unique_ptr<support::WsViewer> viewer_;
  const protocol::Welcome* welcome_ = nullptr;
  const bool speaks_;  // the protocol, which the peer does not
  bool got_first_ = true, is_complete_ = true;
  std::uint32_t sequence_ = 0;
  double sent_at_ = 0.0, last_group_ = 0.0;
};

/// Waits for what the viewers' sockets get.
class Poll {
 public:
  Poll() : epoll_(::epoll_create1(EPOLL_CLOEXEC)) {}
  void add(std::vector<std::unique_ptr<Flyer>>& flyers) {
    for (auto& flyer : flyers) add(*flyer);
  }
  void add(Flyer& flyer) {
    epoll_event event{};
    event.events = EPOLLIN;
    event.data.ptr = &flyer;
    ::epoll_ctl(epoll_.get(), EPOLL_CTL_ADD, flyer.viewer().handle(), &event);
  }
  /// Reads what there is, waiting for so long at most; `then` is called for each viewer that got something.
  template <class Then>
  void wait(double seconds, Then then) {
    epoll_event events[64];
    const int count = ::epoll_wait(epoll_.get(), events, 64, std::max(0, static_cast<int>(1e3 * seconds)));
    for (int i = 0; i < count; ++i) {
      auto* flyer = static_cast<Flyer*>(events[i].data.ptr);
      if (!flyer->viewer().read()) bench::stop("the server closed a connection");
      then(*flyer);
    }
  }

 private:
  base::FileDescriptor epoll_;
};

protocol::Welcome welcomeFrom(std::uint16_t port) {
  auto client = server::LoopbackClient::connect(port);
  if (!client || !client->send(protocol::Hello{})) bench::stop("no viewer can connect");
  auto message = client->receive();
  if (!message || !std::holds_alternative<protocol::Welcome>(*message)) bench::stop("no Welcome came");
  return std::get<protocol::Welcome>(*message);
}

std::vector<std::unique_ptr<Flyer>> openFlyers(std::uint16_t port, std::size_t count, Measured& measured,
                                               const protocol::Welcome& welcome, bool speaks) {
  std::vector<std::unique_ptr<Flyer>> flyers;
  for (std::size_t i = 0; i < count; ++i) {
    flyers.push_back(std::make_unique<Flyer>(measured, static_cast<double>(i) / static_cast<double>(count), speaks));
    if (!flyers.back()->open(port)) bench::stop("a viewer was refused");
    flyers.back()->ready(welcome);
  }
  return flyers;
}

constexpr double kTurnsOfAJump = 0.37;

/// Each viewer jumps to the next view as soon as the last is complete, on our server or, where none `speaks`, on the
/// peer's.
Measured jump(std::uint16_t port, std::size_t viewers, double seconds, const protocol::Welcome& welcome,
              std::uint32_t visit, bool speaks) {
  Measured measured;
  auto flyers = openFlyers(port, viewers, measured, welcome, speaks);
  Poll poll;
  poll.add(flyers);
  for (auto& flyer : flyers) flyer->look(0.0);
  const double start = bench::seconds();
  while (bench::seconds() - start < seconds) {
    poll.wait(0.1, [&](Flyer& flyer) {
      if (!flyer.isComplete()) return;
      if (flyer.sequence() % visit == 0) {
        if (!flyer.open(port)) bench::stop("a viewer was refused");
        poll.add(flyer);
      }
      flyer.look(kTurnsOfAJump * flyer.sequence());
    });
  }
  measured.seconds = bench::seconds() - start;
  return measured;
}

/// Each viewer sends `rate` views a second along its circle, one turn a minute.
Measured fly(std::uint16_t port, std::size_t viewers, double rate, double seconds, const protocol::Welcome& welcome) {
  Measured measured;
  auto flyers = openFlyers(port, viewers, measured, welcome, true);
  Poll poll;
  poll.add(flyers);
  const double start = bench::seconds();
  std::vector<double> next;
  for (std::size_t i = 0; i < viewers; ++i)
    next.push_back(start + static_cast<double>(i) / static_cast<double>(viewers) / rate);
  while (bench::seconds() - start < seconds) {
    const double now = bench::seconds();
    for (std::size_t i = 0; i < viewers; ++i) {
      if (now < next[i]) continue;
      next[i] += 1.0 / rate;
      flyers[i]->look((now - start) / 60.0);
    }
    poll.wait(std::min(0.02, *std::min_element(next.begin(), next.end()) - bench::seconds()), [](Flyer&) {});
  }
  measured.seconds = bench::seconds() - start;
  return measured;
}

/// The messages that the server sends for each view of a visit, Completion included, by which the peer is loaded.
std::vector<std::vector<base::Bytes>> messagesOfAVisit(std::uint16_t port, const protocol::Welcome& welcome,
                                                       std::uint32_t visit) {
  auto client = server::LoopbackClient::connect(port);
  client->send(protocol::Hello{});
  client->receive();
  std::vector<std::vector<base::Bytes>> answers(visit);
  for (std::uint32_t view = 0; view < visit; ++view) {
    client->send(viewOf(welcome, view + 1, kTurnsOfAJump * view));
    for (bool complete = false; !complete;) {
      auto message = client->receive();
      if (!message) bench::stop("a view was not completed");
      const auto* completion = std::get_if<protocol::Completion>(&*message);
      complete = completion != nullptr && completion->sequence == view + 1;
      answers[view].push_back(protocol::encode(*message));
    }
  }
  return answers;
}

void print(const char* name, const Measured& m, double cpu) {
  std::printf(
      "%-12s %7.0f MB/s  %6.0f views/s  %5.1f %% complete  first p50 %6.1f p99 %7.1f ms  groups p99 %7.1f ms  "
      "complete p50 %6.1f p99 %7.1f ms  CPU %5.2f ms a view\n",
      name, 1e-6 * static_cast<double>(m.bytes) / m.seconds, static_cast<double>(m.views) / m.seconds,
      100.0 * static_cast<double>(m.completed) / static_cast<double>(std::max<std::uint64_t>(1, m.views)),
      1e3 * quantile(m.first, 0.5), 1e3 * quantile(m.first, 0.99), 1e3 * quantile(m.groups, 0.99),
      1e3 * quantile(m.complete, 0.5), 1e3 * quantile(m.complete, 0.99),
      1e3 * cpu / static_cast<double>(std::max<std::uint64_t>(1, m.views)));
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(
      argc, argv,
      "SCENE [--viewers N] [--idle N] [--rate N] [--seconds N] [--rounds N] [--visit N] [--only throughput|flying]");
  const auto viewers = arguments.number<std::size_t>("--viewers", 64, 1, 2000);
  const auto idle = arguments.number<std::size_t>("--idle", 1000, 0, 3000);
  const auto rate = arguments.number<unsigned>("--rate", 10, 1, 1000);
  const auto seconds = arguments.number<unsigned>("--seconds", 8, 1, 3600);
  const auto rounds = arguments.number<unsigned>("--rounds", 3, 1, 100);
  const auto visit = arguments.number<std::uint32_t>("--visit", 8, 1, 1000);
  const std::string only = arguments.text("--only", "");
  arguments.finish();
  if (arguments.input().empty()) arguments.wrong();

  std::vector<double> ratios, first_ratios;
  for (unsigned round = 0; round < rounds; ++round) {
    const ServeProcess serve(arguments.input());
    const protocol::Welcome welcome = welcomeFrom(serve.port);
    const server::PlainSender sender(messagesOfAVisit(serve.port, welcome, visit));
    double cpu = serve.cpuSeconds();
    if (only != "flying") {
      const Measured ours = jump(serve.port, viewers, seconds, welcome, visit, true);
      print("throughput", ours, serve.cpuSeconds() - cpu);
      const Measured bare = jump(sender.port(), viewers, seconds, welcome, visit, false);
      print("  bare Beast", bare, 0.0);
      ratios.push_back(static_cast<double>(ours.bytes) / ours.seconds * bare.seconds / static_cast<double>(bare.bytes));
      first_ratios.push_back(quantile(ours.first, 0.99) / quantile(bare.first, 0.99));
    }
    if (only == "throughput") continue;
    cpu = serve.cpuSeconds();
    const Measured flying = fly(serve.port, viewers, rate, seconds, welcome);
    print("flying", flying, serve.cpuSeconds() - cpu);
  }
  if (!ratios.empty())
    std::printf("bytes per second over the peer's: %.2f; p99 of the first byte over the peer's: %.1f (medians of %u)\n",
                bench::median(ratios), bench::median(first_ratios), rounds);

  if (idle > 0) {
    const ServeProcess serve(arguments.input());
    const protocol::Welcome welcome = welcomeFrom(serve.port);
    const double before = serve.memory();
    Measured measured;
    auto flyers = openFlyers(serve.port, idle, measured, welcome, true);
    Poll poll;
    poll.add(flyers);
    const double start = bench::seconds();
    while (bench::seconds() - start < 2.0) poll.wait(0.1, [](Flyer&) {});
    std::printf("%zu idle viewers: %.1f KB each\n", idle, (serve.memory() - before) / 1e3 / static_cast<double>(idle));
  }
  return 0;
}
