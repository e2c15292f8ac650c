#include "client/source/range_queue.h"

#include <algorithm>

namespace client {
namespace {

/// Neighbours are joined up to this share of what may be under way, so that a request does not fill the link alone.
constexpr std::uint64_t kRequestsInWindow = 3;
/// So much may be under way of wishes that lead, beside all others. A choice: eight pages of a table.
constexpr std::uint64_t kLeadingBytes = 8 * 1024;

}  // namespace

RangeQueue::~RangeQueue() {
  for (const auto& [id, request] : requests_) fetcher_.cancel(id);
}

bool RangeQueue::mayAsk(bool leads) const {
  std::uint64_t bytes = 0;
  for (const auto& [id, request] : requests_) bytes += request.leads() == leads ? request.length : 0;
  return bytes < (leads ? kLeadingBytes : window_.bytes());
}

/// Returns `first` and the wishes that can share its request: the same object, close enough, and together at most
/// max_bytes and a third of the window.
std::vector<std::size_t> RangeQueue::neighboursOf(const std::vector<RangeWish>& wishes, std::size_t first) const {
  std::vector<std::size_t> chosen{first};
  if (wishes[first].alone) return chosen;
  const auto itemOf = [&](std::size_t i) { return std::pair(wishes[i].kind, wishes[i].key); };
  std::vector<std::size_t> others;
  for (std::size_t i = 0; i < wishes.size(); ++i)
    if (itemOf(i) != itemOf(first) && !wishes[i].alone && wishes[i].leads == wishes[first].leads &&
        wishes[i].object == wishes[first].object && !underWay(wishes[i].kind, wishes[i].key))
      others.push_back(i);
  const std::uint64_t max_bytes = std::min(options_.max_bytes, window_.bytes() / kRequestsInWindow);
  std::sort(others.begin(), others.end(),
            [&](std::size_t a, std::size_t b) { return wishes[a].offset < wishes[b].offset; });
  // Several groups wish for the same page of the tables, several images for the same block of the index.
  others.erase(
      std::unique(others.begin(), others.end(), [&](std::size_t a, std::size_t b) { return itemOf(a) == itemOf(b); }),
      others.end());

  // Grow outwards from the first wish, towards higher offsets and then towards lower ones.
  std::uint64_t begin = wishes[first].offset;
  std::uint64_t end = begin + wishes[first].length;
  const auto fits = [&](const RangeWish& wish) {
    return std::max(end, wish.offset + wish.length) - std::min(begin, wish.offset) <= max_bytes;
  };
  for (const std::size_t i : others) {
    const RangeWish& wish = wishes[i];
    if (wish.offset < begin || wish.offset > end + options_.max_gap || !fits(wish)) continue;
    end = std::max(end, wish.offset + wish.length);
    chosen.push_back(i);
  }
  for (auto i = others.rbegin(); i != others.rend(); ++i) {
    const RangeWish& wish = wishes[*i];
    if (wish.offset >= begin || wish.offset + wish.length + options_.max_gap < begin || !fits(wish)) continue;
    begin = wish.offset;
    end = std::max(end, wish.offset + wish.length);
    chosen.push_back(*i);
  }
  return chosen;
}

void RangeQueue::send(std::vector<RangeWish> wishes) {
  std::uint64_t begin = wishes.front().offset;
  std::uint64_t end = begin;
  const std::uint64_t id = ++sent_;
  for (const RangeWish& wish : wishes) {
    begin = std::min(begin, wish.offset);
    end = std::max(end, wish.offset + wish.length);
    under_way_[{wish.kind, wish.key}] = id;
  }
  const std::string object = wishes.front().object;
  const bool was_idle =
      std::all_of(requests_.begin(), requests_.end(), [&](const auto& other) { return other.second.sent.at == now_; });
  requests_[id] = {begin, end - begin, {now_, bytes_, was_idle}, std::move(wishes)};
  fetcher_.submit(id, object, begin, end - begin);
}

void RangeQueue::request(const std::vector<RangeWish>& wishes, std::size_t limit) {
  limit = std::min(limit, options_.max_requests);
  for (std::size_t i = 0; i < wishes.size() && requests_.size() < limit; ++i) {
    if (underWay(wishes[i].kind, wishes[i].key) || !mayAsk(wishes[i].leads)) continue;
    std::vector<RangeWish> together;
    for (const std::size_t n : neighboursOf(wishes, i)) together.push_back(wishes[n]);
    send(std::move(together));
  }
}

std::vector<RangeArrival> RangeQueue::takeArrivals() {
  std::vector<RangeArrival> arrivals;
  for (FetchAnswer& answer : fetcher_.takeAnswers()) {
    const auto it = requests_.find(answer.id);
    if (it == requests_.end()) continue;
    const Request request = std::move(it->second);
    requests_.erase(it);
    bytes_ += answer.bytes.size();
    window_.answered(request.sent, {now_, bytes_});
    for (const RangeWish& wish : request.wishes) {
      under_way_.erase({wish.kind, wish.key});
      RangeArrival arrival{wish, {answer.id, answer.outcome, {}, answer.status, answer.detail}};
      const std::uint64_t begin = wish.offset - request.offset;
      if (answer.outcome == FetchOutcome::kBytes && answer.bytes.size() < begin + wish.length)
        arrival.answer.outcome = FetchOutcome::kNetwork;  // the fetcher returned fewer bytes than it promised
      if (arrival.answer.outcome == FetchOutcome::kBytes)
        arrival.answer.bytes.assign(answer.bytes.begin() + static_cast<std::ptrdiff_t>(begin),
                                    answer.bytes.begin() + static_cast<std::ptrdiff_t>(begin + wish.length));
      arrivals.push_back(std::move(arrival));
    }
  }
  return arrivals;
}

}  // namespace client
