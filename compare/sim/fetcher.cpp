#include "compare/sim/fetcher.h"

#include <algorithm>
#include <utility>

namespace compare {
namespace {

constexpr std::uint32_t kConnections = 6;
constexpr std::size_t kRequestBytes = 400;  // request line and headers of a browser
constexpr std::size_t kHeadBytes = 300;     // status line and headers of an answer

}  // namespace

SimulatedFetcher::SimulatedFetcher(ReadObject read, const LinkProfile& link, std::uint32_t seed)
    : read_(std::move(read)), round_trip_(link.round_trip_seconds) {
  const auto up = std::make_shared<Wire>(link), down = std::make_shared<Wire>(link);
  for (std::uint32_t i = 0; i < kConnections; ++i)
    connections_.push_back({Pipe(up, seed + 2 * i), Pipe(down, seed + 2 * i + 1)});
}

void SimulatedFetcher::submit(std::uint64_t id, const std::string& name, std::uint64_t offset, std::uint64_t length) {
  waiting_.push_back({id, name, offset, length});
  ++requests_;
  advance(now_);
}

void SimulatedFetcher::start(Connection& connection) {
  connection.request = waiting_.front();
  waiting_.pop_front();
  connection.sends_at = connection.open ? now_ : now_ + round_trip_;
  connection.open = true;
}

void SimulatedFetcher::act(Connection& connection) {
  if (!connection.request && !waiting_.empty()) start(connection);
  if (connection.sends_at <= now_) {
    connection.sends_at = kNever;
    connection.up.send(base::Bytes(kRequestBytes), now_);
  }
  connection.up.advance(now_);
  if (connection.up.take(now_)) connection.down.send(base::Bytes(kHeadBytes + connection.request->length), now_);
  connection.down.advance(now_);
  if (!connection.down.take(now_)) return;
  const Request done = *std::exchange(connection.request, std::nullopt);
  delivered_ += kHeadBytes + done.length;
  if (!done.cancelled) answer(done);
}

/// An error answer counts as many bytes as the range that was asked for, though it has none: whole scenes give none.
void SimulatedFetcher::answer(const Request& request) {
  client::FetchAnswer answer;
  answer.id = request.id;
  auto bytes = read_(request.name, request.offset, request.length);
  if (bytes) {
    answer.outcome = client::FetchOutcome::kBytes;
    answer.bytes = std::move(*bytes);
    answer.status = 206;
  } else {
    const bool missing = bytes.error().code == base::ErrorCode::kNotFound;
    answer.outcome = missing ? client::FetchOutcome::kNotFound : client::FetchOutcome::kTooShort;
    answer.status = missing ? 404 : 416;
  }
  answers_.push_back(std::move(answer));
}

void SimulatedFetcher::advance(double now) {
  now_ = std::max(now_, now);
  for (Connection& connection : connections_) act(connection);
}

double SimulatedFetcher::nextEvent() const {
  double next = kNever;
  for (const Connection& connection : connections_) {
    if (!connection.request && !waiting_.empty()) next = std::min(next, now_);
    next = std::min({next, connection.sends_at, connection.up.nextEvent(), connection.down.nextEvent()});
  }
  return next;
}

std::vector<client::FetchAnswer> SimulatedFetcher::takeAnswers() {
  return std::exchange(answers_, {});
}

/// A request on its way is answered all the same, as HTTP/1.1 cannot take it back without closing the connection.
void SimulatedFetcher::cancel(std::uint64_t id) {
  std::erase_if(waiting_, [id](const Request& request) { return request.id == id; });
  std::erase_if(answers_, [id](const client::FetchAnswer& answer) { return answer.id == id; });
  for (Connection& connection : connections_)
    if (connection.request && connection.request->id == id) connection.request->cancelled = true;
}

}  // namespace compare
