#include "client/native/curl_fetcher.h"

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <thread>
#include <unordered_set>
#include <utility>

#include "base/byte_range.h"
#include "client/native/http_request.h"

namespace client {
namespace {

using Clock = LinkClock::Clock;

/// These three are choices. A transfer counts as stalled when it stays below the rate for kStallSeconds. The rate is so
/// low that only dead connections end: with a higher one, links that are merely slow would be cut off. With longer
/// times a viewer waits longer for a host that is gone.
constexpr long kConnectSeconds = 10;
constexpr long kStallBytesPerSecond = 256;
constexpr long kStallSeconds = 20;
/// As many as browsers open for one host over HTTP/1.1.
constexpr long kConnections = 6;

struct RangeOrder {
  std::uint64_t id = 0;
  std::string name;
  std::uint64_t offset = 0, length = 0;
  bool whole = false;  // then `length` is the limit
};

/// A request under way.
struct Transfer {
  RangeOrder order;
  base::CurlHandle handle;
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
void Transfer::judgeHead() {
  constexpr int kOk = 200, kPartial = 206;
  const int status = head.status;
  const std::string encoding = head.header("content-encoding");
  const auto size = base::parseDecimal(head.header("content-length"));
  if (status == 404 || status == 410) {
    verdict = answer(FetchOutcome::kNotFound);
  } else if (status == 401 || status == 403) {
    verdict = answer(FetchOutcome::kForbidden);
  } else if (status == 412) {
    verdict = answer(FetchOutcome::kChanged);
  } else if (status == 416) {
    verdict = answer(FetchOutcome::kTooShort);
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

bool Transfer::addBody(base::ByteView bytes) {
  if (body.empty() && !verdict) judgeHead();
  if (verdict) return false;
  if (bytes.size() > order.length - body.size()) {
    verdict = answer(FetchOutcome::kServer, "more came than was announced");
    return false;
  }
  body.insert(body.end(), bytes.begin(), bytes.end());
  return true;
}

FetchAnswer Transfer::finish(CURLcode code) {
  if (head.status != 0 && !verdict && head.complete) judgeHead();
  if (verdict) return std::move(*verdict);
  if (code != CURLE_OK) return answer(FetchOutcome::kNetwork, curl_easy_strerror(code));
  if (!order.whole && body.size() != order.length) return answer(FetchOutcome::kNetwork, "the answer is cut short");
  FetchAnswer good = answer(FetchOutcome::kBytes);
  good.bytes = std::move(body);
  return good;
}

}  // namespace

struct CurlFetcher::Impl {
  Impl(const std::string& where, const LinkLimit& limit) : place(where) {
    link_clock.setLimit(limit);
    curl_multi_setopt(multi.get(), CURLMOPT_MAX_HOST_CONNECTIONS, kConnections);
    thread = std::thread([this] { run(); });
  }
  ~Impl() {
    {
      const std::lock_guard lock(mutex);
      ending = true;
    }
    curl_multi_wakeup(multi.get());
    thread.join();
    for (const auto& [handle, transfer] : transfers) curl_multi_remove_handle(multi.get(), handle);
  }

  struct Due {
    FetchAnswer answer;
    Clock::time_point due;
  };

  // These run on the thread.
  void run();
  void startOrders();
  void start(RangeOrder order);
  void end(CURL* handle);
  void collect();
  void checkVersion(const Transfer& transfer, FetchAnswer& answer);

  void push(RangeOrder order) {
    {
      const std::lock_guard lock(mutex);
      orders.push_back(std::move(order));
    }
    curl_multi_wakeup(multi.get());
  }

  const std::string place;
  const base::CurlMulti multi = base::makeCurlMulti();
  std::map<CURL*, std::unique_ptr<Transfer>> transfers;
  std::vector<base::CurlHandle> idle;
  std::map<std::string, std::string> versions;  // object -> its ETag or date

  // These are shared by both threads, under the mutex.
  std::mutex mutex;
  std::condition_variable arrived;
  bool ending = false;
  std::deque<RangeOrder> orders;
  std::unordered_set<std::uint64_t> cancelled;
  std::deque<Due> done;
  LinkClock link_clock;

  std::thread thread;
};

void CurlFetcher::Impl::run() {
  while (true) {
    {
      const std::lock_guard lock(mutex);
      if (ending) return;
    }
    startOrders();
    int running = 0;
    curl_multi_perform(multi.get(), &running);
    collect();
    constexpr int kMilliseconds = 1000;
    curl_multi_poll(multi.get(), nullptr, 0, kMilliseconds, nullptr);
  }
}

void CurlFetcher::Impl::startOrders() {
  std::deque<RangeOrder> taken;
  std::vector<CURL*> dropped;
  {
    const std::lock_guard lock(mutex);
    taken.swap(orders);
    for (const auto& [handle, transfer] : transfers)
      if (cancelled.count(transfer->order.id) != 0) dropped.push_back(handle);
    std::erase_if(taken, [this](const RangeOrder& order) { return cancelled.count(order.id) != 0; });
    cancelled.clear();
  }
  for (CURL* handle : dropped) end(handle);
  for (RangeOrder& order : taken) start(std::move(order));
}

void CurlFetcher::Impl::start(RangeOrder order) {
  if (idle.empty()) idle.push_back(base::makeCurlHandle());
  auto transfer = std::make_unique<Transfer>();
  transfer->order = std::move(order);
  transfer->handle = std::move(idle.back());
  idle.pop_back();
  const RangeOrder& o = transfer->order;
  CURL* handle = transfer->handle.get();
  curl_easy_reset(handle);
  setUpRequest(handle, place + "/" + o.name);
  curl_easy_setopt(handle, CURLOPT_CONNECTTIMEOUT, kConnectSeconds);
  curl_easy_setopt(handle, CURLOPT_LOW_SPEED_LIMIT, kStallBytesPerSecond);
  curl_easy_setopt(handle, CURLOPT_LOW_SPEED_TIME, kStallSeconds);
  base::receiveInto(*transfer, handle);
  if (!o.whole)
    curl_easy_setopt(handle, CURLOPT_RANGE,
                     (std::to_string(o.offset) + "-" + std::to_string(o.offset + o.length - 1)).c_str());
  curl_multi_add_handle(multi.get(), handle);
  transfers[handle] = std::move(transfer);
}

/// Keeps the handle, and with it its connection.
void CurlFetcher::Impl::end(CURL* handle) {
  curl_multi_remove_handle(multi.get(), handle);
  idle.push_back(std::move(transfers.extract(handle).mapped()->handle));
}

/// The first version seen of an object is the one that all its answers must have.
void CurlFetcher::Impl::checkVersion(const Transfer& transfer, FetchAnswer& answer) {
  std::string version = transfer.head.header("etag");
  if (version.rfind("W/", 0) == 0) version = version.substr(2);
  if (version.empty()) version = transfer.head.header("last-modified");
  if (version.empty() || answer.outcome != FetchOutcome::kBytes) return;
  const auto [it, is_first] = versions.emplace(transfer.order.name, version);
  if (!is_first && it->second != version) answer = {answer.id, FetchOutcome::kChanged, {}, answer.status, ""};
}

void CurlFetcher::Impl::collect() {
  int left = 0;
  while (const CURLMsg* message = curl_multi_info_read(multi.get(), &left)) {
    if (message->msg != CURLMSG_DONE) continue;
    CURL* handle = message->easy_handle;
    const CURLcode code = message->data.result;
    const auto it = transfers.find(handle);
    FetchAnswer answer = it->second->finish(code);
    if (!it->second->order.whole) checkVersion(*it->second, answer);
    end(handle);
    {
      const std::lock_guard lock(mutex);
      link_clock.pass(answer.bytes.size(), Clock::now());
      done.push_back({std::move(answer), link_clock.due()});
    }
    arrived.notify_one();
  }
}

CurlFetcher::CurlFetcher(const std::string& place, const LinkLimit& limit)
    : impl_(std::make_unique<Impl>(place, limit)) {}
CurlFetcher::~CurlFetcher() = default;

void CurlFetcher::submit(std::uint64_t id, const std::string& name, std::uint64_t offset, std::uint64_t length) {
  impl_->push({id, name, offset, length, false});
}

void CurlFetcher::submitWhole(std::uint64_t id, const std::string& name, std::uint64_t max_bytes) {
  impl_->push({id, name, 0, max_bytes, true});
}

std::vector<FetchAnswer> CurlFetcher::takeAnswers() {
  std::vector<FetchAnswer> taken;
  const std::lock_guard lock(impl_->mutex);
  const Clock::time_point now = Clock::now();
  while (!impl_->done.empty() && impl_->done.front().due <= now) {
    taken.push_back(std::move(impl_->done.front().answer));
    impl_->done.pop_front();
  }
  return taken;
}

void CurlFetcher::cancel(std::uint64_t id) {
  {
    const std::lock_guard lock(impl_->mutex);
    std::erase_if(impl_->done, [id](const Impl::Due& due) { return due.answer.id == id; });
    impl_->cancelled.insert(id);
  }
  curl_multi_wakeup(impl_->multi.get());
}

void CurlFetcher::wait(double seconds) {
  Impl& s = *impl_;
  std::unique_lock lock(s.mutex);
  waitForDelivery(lock, s.arrived, s.done, seconds);
}

}  // namespace client
