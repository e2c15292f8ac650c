#include "compare/sim/link.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "base/number.h"
#include "client/native/units.h"

namespace compare {
namespace {

constexpr std::uint64_t kSegmentBytes = 1460;
constexpr std::uint64_t kHeaderBytes = 40;  // IP and TCP, on the wire but not in the stream
constexpr double kFirstWindow = 10.0;       // RFC 6928
constexpr double kQueueBytes = 65536.0;
constexpr double kQueueShare = 1.5;  // of what the link holds
constexpr double kMinIdleSeconds = 0.2;
constexpr double kMaxLoss = 0.5;

base::Error badLink(const std::string& text, const std::string& problem) {
  return {base::ErrorCode::kInvalidInput,
          "link '" + text + "': " + problem + "; write rate/round trip[/jitter[/loss]], such as 20Mbit/40ms, or train"};
}

std::vector<std::string> split(const std::string& text) {
  std::vector<std::string> parts;
  std::size_t begin = 0;
  while (true) {
    const std::size_t slash = text.find('/', begin);
    parts.push_back(text.substr(begin, slash - begin));
    if (slash == std::string::npos) return parts;
    begin = slash + 1;
  }
}

std::optional<double> percentage(const std::string& text) {
  if (text.empty() || text.back() != '%') return std::nullopt;
  const auto value = base::parseNumber(std::string_view(text).substr(0, text.size() - 1));
  return value && *value >= 0.0 && *value <= 100.0 * kMaxLoss ? std::optional(0.01 * *value) : std::nullopt;
}

}  // namespace

base::Result<LinkProfile> parseLink(const std::string& text) {
  LinkProfile link;
  std::string spelled = text;
  if (text == "train") {
    spelled = "20Mbit/40ms";
    link.on_seconds = 10.0;
    link.off_seconds = 5.0;
    link.up_already_seconds = 7.0;
  }
  const std::vector<std::string> parts = split(spelled);
  if (parts.size() < 2 || parts.size() > 4) return badLink(text, "it has " + std::to_string(parts.size()) + " parts");
  const auto rate = client::parseBitRate(parts[0]);
  if (!rate) return badLink(text, rate.error().message);
  if (!(*rate > 0.0)) return badLink(text, "the rate must be above 0");
  const auto round_trip = client::parseDuration(parts[1]);
  if (!round_trip) return badLink(text, round_trip.error().message);
  if (parts.size() > 2) {
    const auto jitter = client::parseDuration(parts[2]);
    if (!jitter) return badLink(text, jitter.error().message);
    link.jitter_seconds = *jitter;
  }
  if (parts.size() > 3) {
    const auto loss = percentage(parts[3]);
    if (!loss) return badLink(text, "the loss must be 0% to 50%");
    link.loss = *loss;
  }
  link.name = text;
  link.bytes_per_second = *rate;
  link.round_trip_seconds = *round_trip;
  return link;
}

double Wire::whenUp(double time) const {
  if (!(link_.on_seconds > 0.0)) return time;
  const double period = link_.on_seconds + link_.off_seconds;
  const double begin = std::floor((time + link_.up_already_seconds) / period) * period - link_.up_already_seconds;
  return time - begin < link_.on_seconds ? time : begin + period;
}

double Wire::depart(std::uint64_t bytes, double now) {
  free_ = whenUp(std::max(free_, now)) + static_cast<double>(bytes) / link_.bytes_per_second;
  return free_;
}

Pipe::Pipe(std::shared_ptr<Wire> wire, std::uint32_t seed)
    : wire_(std::move(wire)), random_(seed), window_(kFirstWindow), threshold_(kNever) {
  const LinkProfile& link = wire_->link();
  const double held = link.bytes_per_second * (link.round_trip_seconds + link.jitter_seconds);
  max_window_ = std::max(kFirstWindow, (held + std::max(kQueueBytes, kQueueShare * held)) / kSegmentBytes);
}

void Pipe::send(base::Bytes message, double now) {
  written_ += message.size();
  messages_.push_back({written_, std::move(message)});
  const double idle = std::max(kMinIdleSeconds, wire_->link().round_trip_seconds);
  if (acks_.empty() && now - last_sent_ > idle) window_ = std::min(window_, kFirstWindow);
  advance(now);
}

void Pipe::advance(double now) {
  while (true) {
    // An acknowledgement opens the window when it arrives, not when somebody looks.
    if (sent_ < written_ && static_cast<double>(acks_.size()) < window_) {
      sendSegment(now);
      continue;
    }
    if (acks_.empty() || acks_.front().arrives > now) return;
    acknowledge(acks_.front());
    acks_.pop_front();
  }
}

void Pipe::sendSegment(double now) {
  const LinkProfile& link = wire_->link();
  const std::uint64_t bytes = std::min(kSegmentBytes, written_ - sent_);
  sent_ += bytes;
  last_sent_ = now;
  double arrives = wire_->depart(bytes + kHeaderBytes, now) + oneWay();
  bool lost = false;
  while (link.loss > 0.0 && random_() < link.loss) {
    lost = true;
    arrives += link.round_trip_seconds;  // sent again; the few bytes take no room on the wire
  }
  if (link.jitter_seconds > 0.0) arrives += link.jitter_seconds * random_();
  last_arrival_ = std::max(last_arrival_, arrives);
  arriving_.push_back({last_arrival_, sent_});
  acks_.push_back({last_arrival_ + oneWay(), sent_, lost});
}

void Pipe::acknowledge(const Acknowledgement& ack) {
  confirmed_ = ack.end;
  if (ack.lost) {
    if (ack.arrives < halved_until_) return;
    threshold_ = window_ = std::max(2.0, 0.5 * window_);
    halved_until_ = ack.arrives + wire_->link().round_trip_seconds;
    return;
  }
  window_ = std::min(max_window_, window_ + (window_ < threshold_ ? 1.0 : 1.0 / window_));
}

std::optional<base::Bytes> Pipe::take(double now) {
  for (; !arriving_.empty() && arriving_.front().arrives <= now; arriving_.pop_front())
    arrived_ = arriving_.front().end;
  if (messages_.empty() || messages_.front().end > arrived_) return std::nullopt;
  base::Bytes bytes = std::move(messages_.front().bytes);
  messages_.pop_front();
  taken_ += bytes.size();
  return bytes;
}

double Pipe::nextEvent() const {
  double next = kNever;
  if (!arriving_.empty()) next = arriving_.front().arrives;
  if (sent_ < written_ && !acks_.empty()) next = std::min(next, acks_.front().arrives);
  return next;
}

}  // namespace compare
