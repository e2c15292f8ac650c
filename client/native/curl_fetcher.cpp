#include "client/native/curl_fetcher.h"

#include <optional>
#include <utility>

#include "base/byte_range.h"
#include "base/number.h"
#include "client/native/http_request.h"

namespace client {
namespace {

/// These three are choices. A transfer counts as stalled when it stays below the rate for kStallSeconds. The rate is so
/// low that only dead connections end: with a higher one, links that are merely slow would be cut off. With longer
/// times a viewer waits longer for a host that is gone.
constexpr long kConnectSeconds = 10;
constexpr long kStallBytesPerSecond = 256;
constexpr long kStallSeconds = 20;
/// As many as browsers open for one host over HTTP/1.1.
constexpr long kConnections = 6;

}  // namespace

/// A request under way.
struct CurlFetcher::Transfer {
  RangeOrder order;
  base::CurlHandle handle;
  CurlProblem problem{};
  base::HttpHead head;
  base::Bytes body;
  std::optional<FetchAnswer> verdict;  // known before the body: the transfer is aborted

  void judgeHead();
  bool addHeader(std::string_view line) { return head.addLine(line); }
  bool addBody(base::ByteView bytes);
  FetchAnswer finish(CURLcode code);
  FetchAnswer answer(FetchOutcome outcome, const std::string& detail = "") const {
    return {order.id, outcome, {}, head.status, detail};
  }
};

/// Judges the head of the answer, before any byte of the body is read.
void CurlFetcher::Transfer::judgeHead() {
  constexpr int kOk = 200, kPartial = 206;
  static const std::map<int, FetchOutcome> kOutcomes{{401, FetchOutcome::kForbidden}, {403, FetchOutcome::kForbidden},
                                                     {404, FetchOutcome::kNotFound},  {410, FetchOutcome::kNotFound},
                                                     {412, FetchOutcome::kChanged},   {416, FetchOutcome::kTooShort}};
  const int status = head.status;
  const std::string encoding = head.header("content-encoding");
  const auto size = base::parseDecimal(head.header("content-length"));
  if (const auto refused = kOutcomes.find(status); refused != kOutcomes.end()) {
    verdict = answer(refused->second);
  } else if (status != kOk && status != kPartial) {
    verdict = answer(FetchOutcome::kServer);
  } else if (!encoding.empty() && encoding != "identity") {
    verdict = answer(FetchOutcome::kCompressed);
  } else if (order.whole) {
    if (status != kOk || (size && *size > order.length)) verdict = answer(FetchOutcome::kServer, "too long");
  } else if (status == kOk) {
    // This is right only when the requested range is the whole object.
    if (order.offset != 0 || !size || *size != order.length) verdict = answer(FetchOutcome::kRangeIgnored);
  } else {
    const auto range = base::parseContentRange(head.header("content-range"));
    const std::uint64_t last = order.offset + order.length - 1;
    if (range && range->has_bytes && range->first == order.offset && range->last < last)
      verdict = answer(FetchOutcome::kTooShort);
    else if (!range || !range->has_bytes || range->first != order.offset || range->last != last)
      verdict = answer(FetchOutcome::kRangeIgnored, "another range came");
  }
}

bool CurlFetcher::Transfer::addBody(base::ByteView bytes) {
  if (body.empty() && !verdict) judgeHead();
  if (verdict) return false;
  if (bytes.size() > order.length - body.size()) {
    verdict = answer(FetchOutcome::kServer, "more came than was announced");
    return false;
  }
  body.insert(body.end(), bytes.begin(), bytes.end());
  return true;
}

FetchAnswer CurlFetcher::Transfer::finish(CURLcode code) {
  if (head.status != 0 && !verdict && head.complete) judgeHead();
  if (verdict) return std::move(*verdict);
  if (code != CURLE_OK) return answer(FetchOutcome::kNetwork, problemOf(code, problem));
  if (!order.whole && body.size() != order.length) return answer(FetchOutcome::kNetwork, "the answer is cut short");
  FetchAnswer good = answer(FetchOutcome::kBytes);
  good.bytes = std::move(body);
  return good;
}

CurlFetcher::CurlFetcher(const std::string& place, const LinkLimit& limit, const HostAccess& access)
    : place_(place), access_(access) {
  link_clock_.setLimit(limit);
  curl_multi_setopt(multi_.get(), CURLMOPT_MAX_HOST_CONNECTIONS, kConnections);
  thread_ = std::thread([this] { run(); });
}

CurlFetcher::~CurlFetcher() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  curl_multi_wakeup(multi_.get());
  thread_.join();
  for (const auto& [handle, transfer] : transfers_) curl_multi_remove_handle(multi_.get(), handle);
}

void CurlFetcher::push(RangeOrder order) {
  {
    const std::lock_guard lock(mutex_);
    orders_.push_back(std::move(order));
  }
  curl_multi_wakeup(multi_.get());
}

void CurlFetcher::run() {
  while (true) {
    {
      const std::lock_guard lock(mutex_);
      if (ending_) return;
    }
    startOrders();
    int running = 0;
    curl_multi_perform(multi_.get(), &running);
    collect();
    constexpr int kMilliseconds = 1000;
    curl_multi_poll(multi_.get(), nullptr, 0, kMilliseconds, nullptr);
  }
}

void CurlFetcher::startOrders() {
  std::deque<RangeOrder> taken;
  std::vector<CURL*> dropped;
  {
    const std::lock_guard lock(mutex_);
    taken.swap(orders_);
    for (const auto& [handle, transfer] : transfers_)
      if (cancelled_.count(transfer->order.id) != 0) dropped.push_back(handle);
    std::erase_if(taken, [this](const RangeOrder& order) { return cancelled_.count(order.id) != 0; });
    cancelled_.clear();
  }
  for (CURL* handle : dropped) end(handle);
  for (RangeOrder& order : taken) start(std::move(order));
}

void CurlFetcher::start(RangeOrder order) {
  if (idle_.empty()) idle_.push_back(base::makeCurlHandle());
  auto transfer = std::make_unique<Transfer>();
  transfer->order = std::move(order);
  transfer->handle = std::move(idle_.back());
  idle_.pop_back();
  const RangeOrder& o = transfer->order;
  CURL* handle = transfer->handle.get();
  curl_easy_reset(handle);
  setUpRequest(handle, place_ + "/" + o.name, access_, transfer->problem);
  curl_easy_setopt(handle, CURLOPT_CONNECTTIMEOUT, kConnectSeconds);
  curl_easy_setopt(handle, CURLOPT_LOW_SPEED_LIMIT, kStallBytesPerSecond);
  curl_easy_setopt(handle, CURLOPT_LOW_SPEED_TIME, kStallSeconds);
  base::receiveInto(*transfer, handle);
  if (!o.whole)
    curl_easy_setopt(handle, CURLOPT_RANGE,
                     (std::to_string(o.offset) + "-" + std::to_string(o.offset + o.length - 1)).c_str());
  curl_multi_add_handle(multi_.get(), handle);
  transfers_[handle] = std::move(transfer);
}

/// Keeps the handle, and with it its connection.
void CurlFetcher::end(CURL* handle) {
  curl_multi_remove_handle(multi_.get(), handle);
  curl_easy_setopt(handle, CURLOPT_ERRORBUFFER, nullptr);  // goes with the transfer
  idle_.push_back(std::move(transfers_.extract(handle).mapped()->handle));
}

/// The first version seen of an object is the one that all its answers must have.
void CurlFetcher::checkVersion(const Transfer& transfer, FetchAnswer& answer) {
  std::string version = transfer.head.header("etag");
  if (version.rfind("W/", 0) == 0) version = version.substr(2);
  if (version.empty()) version = transfer.head.header("last-modified");
  if (version.empty() || answer.outcome != FetchOutcome::kBytes) return;
  const auto [it, is_first] = versions_.emplace(transfer.order.name, version);
  if (!is_first && it->second != version) answer = {answer.id, FetchOutcome::kChanged, {}, answer.status, ""};
}

void CurlFetcher::collect() {
  int left = 0;
  while (const CURLMsg* message = curl_multi_info_read(multi_.get(), &left)) {
    if (message->msg != CURLMSG_DONE) continue;
    CURL* handle = message->easy_handle;
    const CURLcode code = message->data.result;
    const auto it = transfers_.find(handle);
    FetchAnswer answer = it->second->finish(code);
    if (!it->second->order.whole) checkVersion(*it->second, answer);
    end(handle);
    {
      const std::lock_guard lock(mutex_);
      link_clock_.pass(answer.bytes.size(), LinkClock::Clock::now());
      done_.push_back({std::move(answer), link_clock_.due()});
    }
    arrived_.notify_one();
  }
}

std::vector<FetchAnswer> CurlFetcher::takeAnswers() {
  std::vector<FetchAnswer> taken;
  const std::lock_guard lock(mutex_);
  const LinkClock::Clock::time_point now = LinkClock::Clock::now();
  while (!done_.empty() && done_.front().due <= now) {
    taken.push_back(std::move(done_.front().answer));
    done_.pop_front();
  }
  return taken;
}

void CurlFetcher::cancel(std::uint64_t id) {
  {
    const std::lock_guard lock(mutex_);
    std::erase_if(done_, [id](const Delivery& due) { return due.answer.id == id; });
    cancelled_.insert(id);
  }
  curl_multi_wakeup(multi_.get());
}

void CurlFetcher::wait(double seconds) {
  std::unique_lock lock(mutex_);
  waitForDelivery(lock, arrived_, done_, seconds);
}

}  // namespace client
