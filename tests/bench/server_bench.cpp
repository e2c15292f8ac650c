// server_bench SCENE [--viewers 64] [--idle 1000] [--flights 64x10,16x60] [--seconds 8] [--rounds 3] [--visit 8]
// [--only throughput|flying|climb] [--program FILE]: a server of many viewers who fly, beside a bare Beast server that
// sends the same messages in the same run. Another program than the one that was built here can be measured, too.
//
//   throughput   each viewer jumps to the next view as soon as the last is complete, and comes back as a new one after
//                as many views as --visit says; the peer sends what the server sent for such a visit, view by view
//   flying       each viewer circles the scene and sends so many views a second: 64x10 is 64 viewers at 10 views a
//                second. Views count from the second second on, when the viewers have what they began with. A view has
//                its images with the Completion of it or of a newer one, and its groups with the last group before
//                that. It is late if the next view but three was sent earlier.
//   climb        the same, only if asked for, with half as many viewers more each time until groups need 50 ms or one
//                view of a hundred is late: how busy are the cores then?
//   idle         as many viewers as --idle asks for are connected and look at one view
//
// The viewers run on a thread of this program (ws_viewer.h), the server in a process of its own. The rows tell the
// ratio to the peer, and for latencies the time from sending a view to the first byte of a message for it, to its last
// group and to its Completion.
#include <sys/epoll.h>
#include <sys/wait.h>

#include <algorithm>
#include <cmath>
#include <deque>
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

struct Served {
  std::string program, scene;
};

/// `lumigrid serve` as a child that ends with the object.
class ServeProcess {
 public:
  explicit ServeProcess(const Served& served) {
    int out[2];
    if (::pipe(out) != 0) bench::stop("no pipe");
    pid_ = ::fork();
    if (pid_ == 0) {
      ::dup2(out[1], 1);
      const base::FileDescriptor quiet(::open("/dev/null", O_WRONLY));
      ::dup2(quiet.get(), 2);
      ::execl(served.program.c_str(), "lumigrid", "serve", served.scene.c_str(), "--port", "0", "--json", "--no-frames",
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
  std::uint64_t bytes = 0, views = 0, late = 0;
  double seconds = 0.0;
  double viewers_cpu = 0.0, sender_cpu = 0.0;

  double lateShare() const {
    return static_cast<double>(late) / static_cast<double>(std::max<std::uint64_t>(1, views));
  }
};

/// Seconds that the cores of this machine worked, and that they could have.
struct CoreSeconds {
  double busy = 0.0, all = 0.0;

  static CoreSeconds now() {
    std::ifstream in("/proc/stat");
    std::string name;
    in >> name;
    CoreSeconds sum;
    double ticks = 0.0;
    for (int column = 0; column < 8 && in >> ticks; ++column) {
      const bool is_idle = column == 3 || column == 4;  // idle, and waiting for disks
      sum.all += ticks;
      if (!is_idle) sum.busy += ticks;
    }
    return sum;
  }
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

/// The next view but three.
constexpr std::uint32_t kLateAfter = 4;

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
  /// `counts`: the view is measured.
  void look(double turn, bool counts = true) {
    const std::uint32_t sequence = ++sequence_;
    for (Waiting& view : waiting_)
      if (view.sequence + kLateAfter == sequence && view.counts) ++measured_.late;
    waiting_.push_back({sequence, bench::seconds(), counts});
    got_first_ = false;
    if (counts) ++measured_.views;
    viewer_->send(protocol::encode(protocol::ClientMessage(viewOf(*welcome_, sequence, turn + phase_))));
  }
  bool isComplete() const { return waiting_.empty(); }
  support::WsViewer& viewer() { return *viewer_; }
  std::uint32_t sequence() const { return sequence_; }

 private:
  void accept(base::ByteView front, std::size_t size) {
    if (front.empty()) return;
    const double now = bench::seconds();
    measured_.bytes += size;
    const bool is_data = front[0] == kFace || front[0] == kRefinement;
    if (is_data && !std::exchange(got_first_, true) && !waiting_.empty() && waiting_.back().counts)
      measured_.first.push_back(now - waiting_.back().sent_at);
    if (front[0] == kRefinement) last_group_at_ = now;
    if (front[0] != kCompletion || size < 5) return;
    const std::uint32_t sequence = front[1] | front[2] << 8U | front[3] << 16U | std::uint32_t{front[4]} << 24U;
    // The peer says what it said once.
    while (!waiting_.empty() && (!speaks_ || waiting_.front().sequence <= sequence)) {
      if (waiting_.front().counts) complete(waiting_.front(), now);
      waiting_.pop_front();
    }
  }

  /// A view that has not got all of its groups and images.
  struct Waiting {
    std::uint32_t sequence = 0;
    double sent_at = 0.0;
    bool counts = true;
  };
  void complete(const Waiting& view, double now) {
    measured_.complete.push_back(now - view.sent_at);
    if (last_group_at_ > view.sent_at) measured_.groups.push_back(last_group_at_ - view.sent_at);
  }

  Measured& measured_;
  const double phase_;
  std::unique_ptr<support::WsViewer> viewer_;
  const protocol::Welcome* welcome_ = nullptr;
  const bool speaks_;  // the protocol, which the peer does not
  bool got_first_ = true;
  std::uint32_t sequence_ = 0;
  std::deque<Waiting> waiting_;  // the oldest first
  double last_group_at_ = 0.0;
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
  const double viewers_cpu = bench::seconds(CLOCK_THREAD_CPUTIME_ID);
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
  measured.viewers_cpu = bench::seconds(CLOCK_THREAD_CPUTIME_ID) - viewers_cpu;
  return measured;
}

/// So many viewers, each of whom sends so many views a second.
struct Flight {
  std::size_t viewers = 0;
  double rate = 0.0;
};

std::vector<Flight> flightsFrom(const std::string& text) {
  std::vector<Flight> flights;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find(',', at), text.size());
    Flight flight;
    if (std::sscanf(text.substr(at, end - at).c_str(), "%zux%lf", &flight.viewers, &flight.rate) != 2 ||
        flight.viewers < 1 || flight.viewers > 2000 || !(flight.rate >= 1.0 && flight.rate <= 1000.0))
      bench::stop("--flights takes such as 64x10,16x60");
    flights.push_back(flight);
    at = end + 1;
  }
  return flights;
}

constexpr double kBeforeCounting = 1.0;  // seconds

/// Each viewer flies along its circle, one turn a minute. `begin` is called when views begin to count.
template <class Begin>
Measured fly(std::uint16_t port, const Flight& flight, double seconds, const protocol::Welcome& welcome, Begin begin) {
  Measured measured;
  auto flyers = openFlyers(port, flight.viewers, measured, welcome, true);
  Poll poll;
  poll.add(flyers);
  const double start = bench::seconds();
  const double count_from = start + kBeforeCounting;
  std::vector<double> next;
  for (std::size_t i = 0; i < flyers.size(); ++i)
    next.push_back(start + static_cast<double>(i) / static_cast<double>(flyers.size()) / flight.rate);
  bool has_begun = false;
  for (double now = start; now < count_from + seconds; now = bench::seconds()) {
    if (now >= count_from && !std::exchange(has_begun, true)) begin(), measured.bytes = 0;
    for (std::size_t i = 0; i < flyers.size(); ++i) {
      if (now < next[i]) continue;
      next[i] += 1.0 / flight.rate;
      flyers[i]->look((now - start) / 60.0, has_begun);
    }
    poll.wait(std::min(0.02, *std::min_element(next.begin(), next.end()) - bench::seconds()), [](Flyer&) {});
  }
  measured.seconds = bench::seconds() - count_from;
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

void print(const char* name, const Measured& m) {
  std::printf(
      "%-12s %7.0f MB/s  %6.0f views/s  first p50 %6.1f p99 %7.1f ms  groups p99 %7.1f ms  complete p50 %6.1f p99 "
      "%7.1f ms  CPU, ns a byte: sender %5.3f viewers %5.3f\n",
      name, 1e-6 * static_cast<double>(m.bytes) / m.seconds, static_cast<double>(m.views) / m.seconds,
      1e3 * quantile(m.first, 0.5), 1e3 * quantile(m.first, 0.99), 1e3 * quantile(m.groups, 0.99),
      1e3 * quantile(m.complete, 0.5), 1e3 * quantile(m.complete, 0.99),
      1e9 * m.sender_cpu / static_cast<double>(m.bytes), 1e9 * m.viewers_cpu / static_cast<double>(m.bytes));
  std::fflush(stdout);
}

/// Views that the server planned for so far.
double viewsPlanned(std::uint16_t port) {
  const std::string text = server::httpRequest(port, "/metrics").body;
  const auto at = text.find("\nlumigrid_views_planned_total");
  if (at == std::string::npos) bench::stop("the server tells no number of planned views");
  return std::strtod(text.c_str() + text.find(' ', at), nullptr);
}

/// One flight on a server of its own, so that no flight finds what another one left; prints its row.
Measured flyAlone(const Served& served, const Flight& flight, double seconds) {
  const ServeProcess serve(served);
  const protocol::Welcome welcome = welcomeFrom(serve.port);
  double cpu = 0.0, planned = 0.0;
  CoreSeconds cores;
  Measured m = fly(serve.port, flight, seconds, welcome,
                   [&] { cpu = serve.cpuSeconds(), planned = viewsPlanned(serve.port), cores = CoreSeconds::now(); });
  cpu = serve.cpuSeconds() - cpu, planned = viewsPlanned(serve.port) - planned;
  const CoreSeconds end = CoreSeconds::now();
  std::printf(
      "%4zu at %2.0f/s %6.1f MB/s  groups p50 %6.1f p99 %6.1f ms  images p50 %6.1f p99 %6.1f ms  late %5.2f %%  "
      "planned "
      "%4.0f of %4.0f views/s  CPU %5.2f ms a planned view  cores %3.0f %% busy, server's %3.0f %%\n",
      flight.viewers, flight.rate, 1e-6 * static_cast<double>(m.bytes) / m.seconds, 1e3 * quantile(m.groups, 0.5),
      1e3 * quantile(m.groups, 0.99), 1e3 * quantile(m.complete, 0.5), 1e3 * quantile(m.complete, 0.99),
      100.0 * m.lateShare(), planned / m.seconds, static_cast<double>(m.views) / m.seconds,
      1e3 * cpu / std::max(1.0, planned), 100.0 * (end.busy - cores.busy) / (end.all - cores.all),
      100.0 * cpu / m.seconds / static_cast<double>(std::max(1U, std::thread::hardware_concurrency())));
  std::fflush(stdout);
  return m;
}

void climb(const Served& served, Flight flight, double seconds) {
  constexpr double kGroupsWithin = 0.05, kMostLate = 0.01;
  constexpr std::size_t kMostViewers = 1500;
  while (flight.viewers <= kMostViewers) {
    const Measured m = flyAlone(served, flight, seconds);
    if (quantile(m.groups, 0.99) > kGroupsWithin || m.lateShare() > kMostLate) return;
    flight.viewers += (flight.viewers + 1) / 2;
  }
}

/// Ratios to the peer of bytes a second, and of the 99th percentile of the first byte.
struct Ratios {
  std::vector<double> bytes, first;
};

void jumpBesidePeer(const Served& served, std::size_t viewers, double seconds, std::uint32_t visit, Ratios& ratios) {
  const ServeProcess serve(served);
  const protocol::Welcome welcome = welcomeFrom(serve.port);
  const server::PlainSender sender(messagesOfAVisit(serve.port, welcome, visit));
  const double serve_cpu = serve.cpuSeconds();
  Measured ours = jump(serve.port, viewers, seconds, welcome, visit, true);
  ours.sender_cpu = serve.cpuSeconds() - serve_cpu;
  print("throughput", ours);
  const double own_cpu = bench::seconds(CLOCK_PROCESS_CPUTIME_ID);
  Measured bare = jump(sender.port(), viewers, seconds, welcome, visit, false);
  bare.sender_cpu = bench::seconds(CLOCK_PROCESS_CPUTIME_ID) - own_cpu - bare.viewers_cpu;
  print("  bare Beast", bare);
  ratios.bytes.push_back(static_cast<double>(ours.bytes) / ours.seconds * bare.seconds /
                         static_cast<double>(bare.bytes));
  ratios.first.push_back(quantile(ours.first, 0.99) / quantile(bare.first, 0.99));
}

void printIdle(const Served& served, std::size_t idle) {
  const ServeProcess serve(served);
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

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(argc, argv,
                             "SCENE [--viewers N] [--idle N] [--flights NxRATE,...] [--seconds N] [--rounds N] "
                             "[--visit N] [--only throughput|flying|climb] [--program FILE]");
  const auto viewers = arguments.number<std::size_t>("--viewers", 64, 1, 2000);
  const auto idle = arguments.number<std::size_t>("--idle", 1000, 0, 3000);
  const auto flights = flightsFrom(arguments.text("--flights", "64x10,16x60"));
  const auto seconds = arguments.number<unsigned>("--seconds", 8, 1, 3600);
  const auto rounds = arguments.number<unsigned>("--rounds", 3, 1, 100);
  const auto visit = arguments.number<std::uint32_t>("--visit", 8, 1, 1000);
  const std::string only = arguments.text("--only", "");
  const std::string program = arguments.text("--program", LUMIGRID_PROGRAM);
  arguments.finish();
  if (arguments.input().empty()) arguments.wrong();
  const Served served{program, arguments.input()};

  if (only == "climb") {
    for (const Flight& flight : flights) climb(served, flight, seconds);
    return 0;
  }
  Ratios ratios;
  for (unsigned round = 0; round < rounds; ++round) {
    if (only != "flying") jumpBesidePeer(served, viewers, seconds, visit, ratios);
    if (only == "throughput") continue;
    for (const Flight& flight : flights) flyAlone(served, flight, seconds);
  }
  if (!ratios.bytes.empty())
    std::printf("bytes per second over the peer's: %.2f; p99 of the first byte over the peer's: %.1f (medians of %u)\n",
                bench::median(ratios.bytes), bench::median(ratios.first), rounds);
  if (idle > 0) printIdle(served, idle);
  return 0;
}
